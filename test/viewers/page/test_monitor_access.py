"""Who may see and who may control, and how it is refused to start without that."""

import pytest
from refused import refused

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.viewers.page.access import PageAccess, make_access

TOKEN = "0123456789abcdef"


@pytest.fixture
def token_file(tmp_path):
    path = tmp_path / "token"
    path.write_text(TOKEN + "\nanything\n")
    path.chmod(0o600)
    return path


def test_on_loopback_a_token_is_made():
    one, other = make_access("127.0.0.1", ""), make_access("::1", "")
    assert one.made and len(one.token) == 32 and one.token != other.token
    assert one.may_view("") and not one.knows("") and one.knows(one.token)


def test_others_need_a_token_to_look_on(token_file):
    with refused(Refusal, "exposed", "token_file"):
        make_access("0.0.0.0", "")
    access = make_access("0.0.0.0", str(token_file))
    assert not access.made and access.token == TOKEN
    assert access.may_view(TOKEN) and not access.may_view("") and not access.may_view(TOKEN + "x")


def test_a_token_that_others_read_or_guess_is_refused(token_file, tmp_path):
    token_file.chmod(0o640)
    with refused(Refusal, "exposed", "600"):
        make_access("127.0.0.1", str(token_file))
    token_file.write_text("short\n")
    token_file.chmod(0o600)
    with refused(Refusal, "too_few", "16"):
        make_access("127.0.0.1", str(token_file))
    with pytest.raises(FileNotFoundError):
        make_access("127.0.0.1", str(tmp_path / "none"))


@pytest.mark.parametrize(
    ("address", "host", "refused"),
    [
        ("127.0.0.1", "127.0.0.1:8470", False),
        ("127.0.0.1", "localhost:8470", False),
        ("127.0.0.1", "[::1]:8470", False),
        ("127.0.0.1", "evil.example:8470", True),
        ("127.0.0.1", "10.0.0.5:8470", True),
        ("127.0.0.1", "", True),
        ("127.0.0.1", "127.0.0.1.evil.example", True),
        ("0.0.0.0", "10.0.0.5:8470", False),
        ("0.0.0.0", "[fe80::1]:8470", False),
        ("0.0.0.0", "evil.example:8470", True),
        ("cell.factory", "cell.factory:8470", False),
    ],
)
def test_a_name_that_is_not_ours_is_refused(address, host, refused):
    assert PageAccess(address, TOKEN, made=False).refuses_host(host) is refused


@pytest.mark.parametrize(
    ("origin", "refused"),
    [
        (None, False),
        ("http://127.0.0.1:8470", False),
        ("http://127.0.0.1:8471", True),
        ("https://evil.example", True),
        ("null", True),
    ],
)
def test_the_page_of_another_site_is_refused(origin, refused):
    assert PageAccess.refuses_origin(origin, "127.0.0.1:8470") is refused
