from stepdiag_ros.run.supervision import (
    MOST_PEERS,
    ONLOOKERS,
    OPERATOR_ROLE,
    SILENCE_LIMIT,
    WORKER_LIMIT,
    Peer,
    Watch,
)


def a_peer(time, session="one", role="recorder", run_id="", faulty=False):
    return Peer(role, time, session, run_id, "all well", faulty)


def test_a_silent_node_is_lost_once_and_found_again():
    watch = Watch()
    watch.heard("/recorder", a_peer(0.0))
    assert watch.check(SILENCE_LIMIT - 0.1) == []
    found = watch.check(SILENCE_LIMIT + 0.1)
    assert len(found) == 1 and "recorder" in found[0] and "silent" in found[0]
    assert watch.check(SILENCE_LIMIT + 0.2) == []
    assert watch.missing(("recorder",)) == found
    watch.heard("/recorder", a_peer(5.0, session="two"))
    assert watch.missing(("recorder",)) == []
    assert watch.twins == set()


def test_commands_and_views_that_end_are_not_missed():
    watch = Watch()
    for role in (OPERATOR_ROLE, *ONLOOKERS):
        watch.heard(f"/{role}", a_peer(0.0, role=role))
    assert watch.check(SILENCE_LIMIT + 0.1) == []
    assert not watch.present(OPERATOR_ROLE)


def test_a_role_that_was_never_heard_is_missing():
    assert Watch().missing(("solver",)) == ["there is no solver node"]


def test_another_node_can_stand_in_for_a_lost_one():
    watch = Watch()
    watch.heard("/a", a_peer(0.0))
    watch.heard("/b", a_peer(3.0, session="two"))
    watch.check(3.0)
    assert "/a" in watch.lost
    assert watch.missing(("recorder",)) == []


def test_a_node_that_says_it_is_faulty_is_missing():
    watch = Watch()
    watch.heard("/recorder", a_peer(0.0, faulty=True))
    assert watch.missing(("recorder",)) == ["recorder: all well"]


def test_presence_can_be_asked_for_a_run():
    watch = Watch()
    watch.heard("/recorder", a_peer(0.0, run_id="r1"))
    assert watch.present("recorder", "r1")
    assert not watch.present("recorder", "r2")


def test_two_processes_of_one_name_are_noticed():
    watch = Watch()
    watch.heard("/recorder", a_peer(0.0, session="one"))
    watch.heard("/recorder", a_peer(0.2, session="two"))
    assert watch.twins == {"/recorder"}


def test_results_that_are_owed_are_waited_for_longer_than_a_node_is_silent():
    watch = Watch()
    for role, left in (("solver", "0"), ("diagnosis", "2")):
        peer = Peer(role, 0.0, role, "", facts={"work_left": left})
        watch.heard(f"/{role}", peer)
    watch.check(SILENCE_LIMIT + 0.1)
    assert watch.missing(("diagnosis",)) != []
    assert watch.workers(SILENCE_LIMIT + 0.1) == ["diagnosis"]
    assert watch.workers(WORKER_LIMIT + 0.1) == []


def test_a_process_that_slept_listens_before_it_judges():
    watch = Watch()
    watch.heard("/recorder", a_peer(0.0))
    for step in range(4):
        assert watch.check(0.25 * step) == []
    # It did not get the computer for ten seconds; the heartbeats of that time are still unread.
    assert watch.check(10.75) == []
    watch.heard("/recorder", a_peer(10.8))
    assert watch.check(11.0) == []
    # One that is really gone is found all the same, a little later.
    found = [watch.check(11.0 + 0.25 * step) for step in range(1, 10)]
    assert [len(said) for said in found] == [0] * 7 + [1, 0]


def test_of_nodes_that_went_the_last_are_named_and_a_heartbeat_stays_short():
    watch = Watch()
    for number in range(MOST_PEERS):
        watch.heard(f"/{number:03d}{'x' * 251}", a_peer(0.001 * number))
    assert watch.missed == ""
    watch.check(SILENCE_LIMIT + 0.5)
    assert len(watch.lost) == MOST_PEERS
    assert len(watch.missed) < 10_000 and watch.missed.startswith(f"/{MOST_PEERS - 1:03d}x")
