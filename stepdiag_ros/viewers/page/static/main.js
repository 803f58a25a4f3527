// Keeps contact with the server, hands each section what has changed, and passes on what is asked.
import { SECTIONS } from "./sections.js";

const SILENT_MS = 3000; // after which there is no contact: the server speaks at least every second
const RETRY_MS = 1000;
const STORED = "stepdiag token";
const at = (id) => document.getElementById(id);

const token = takeToken();
let socket = null;
let heard = 0; // time of the last message of the server
let awaited = 0; // time since which this connection owes a message
let everHeard = false;
let refused = false;
let hello = {};
let pending = {}; // sections to be painted with the next frame
let painting = false;
let state = null; // of the run
let refusedStart = ""; // why no run can be started

function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  try {
    if (given) {
      sessionStorage.setItem(STORED, given);
      // Out of the address line, where it would be seen and copied.
      history.replaceState(null, "", location.pathname);
    }
    return given || sessionStorage.getItem(STORED) || "";
  } catch {
    return given || "";
  }
}

function connect() {
  const mine = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
  socket = mine;
  mine.onopen = () => {
    awaited = performance.now();
    mine.send(JSON.stringify({ token }));
  };
  mine.onmessage = (event) => {
    if (mine !== socket) return;
    const told = JSON.parse(event.data);
    if (told.refused) {
      refused = true;
      contact("refused", told.refused);
      return;
    }
    heard = awaited = performance.now();
    everHeard = true;
    take(told);
    mine.send(String(told.number));
  };
  mine.onclose = () => {
    if (mine !== socket || refused) return;
    setTimeout(connect, RETRY_MS);
  };
}

function contact(how, text) {
  const place = at("contact");
  place.dataset.contact = how;
  if (place.textContent !== text) place.textContent = text;
  document.body.classList.toggle("stale", how !== "good");
  enableControls();
}

function watch() {
  if (refused) return;
  const silent = performance.now() - heard;
  if (everHeard && silent < SILENT_MS) return;
  const since = new Date(Date.now() - silent).toLocaleTimeString([], { hour12: false });
  contact("lost", everHeard ? `no contact since ${since}` : "no contact yet");
  // A connection can be dead without anybody having said so; a new one is given time to begin.
  const dumb = performance.now() - awaited >= SILENT_MS;
  if (everHeard && dumb && socket.readyState === WebSocket.OPEN) {
    const dead = socket;
    socket = null;
    dead.close();
    connect();
  }
}

function take(told) {
  hello = told.hello;
  Object.assign(pending, told.sections);
  if (document.hidden) {
    paint(); // no frames are drawn, and nothing may pile up
  } else if (!painting) {
    painting = true;
    requestAnimationFrame(paint);
  }
}

function paint() {
  painting = false;
  const changed = pending;
  pending = {};
  if (hello.source === "replay") at("replay").hidden = false;
  if (at("title").textContent !== hello.title) at("title").textContent = hello.title;
  at("controls").hidden = !hello.controls;
  at("control-keys").hidden = !hello.controls;
  at("no-controls").hidden = hello.controls || hello.source === "replay";
  for (const [name, told] of Object.entries(changed)) {
    if (SECTIONS[name]) SECTIONS[name](told);
  }
  if (changed.run) {
    state = changed.run.state;
    refusedStart = changed.run.refused_start;
  }
  contact("good", "connected");
}

function enableControls() {
  const can = {
    start: !refusedStart && (state === null || ["IDLE", "FINISHED", "ABORTED"].includes(state)),
    pause: state === "RUNNING",
    resume: ["PAUSED", "WAITING_FOR_SETUP", "FAULT"].includes(state),
    // Never taken away while anything may go on.
    abort: !["IDLE", "FINISHED", "ABORTED"].includes(state),
  };
  const lost = at("contact").dataset.contact !== "good";
  for (const button of document.querySelectorAll("#controls button")) {
    const action = button.dataset.action;
    button.disabled = !(can[action] && (!lost || action === "abort"));
  }
}

const QUESTIONS = {
  start: "Start the run? The machine will move.",
  resume: "Resume the run? The machine will move.",
};

function confirmed(question) {
  const dialog = at("confirm");
  if (dialog.open) return Promise.resolve(false);
  at("confirm-text").textContent = question;
  dialog.returnValue = "no";
  dialog.showModal();
  return new Promise((answer) => {
    dialog.onclose = () => answer(dialog.returnValue === "yes");
  });
}

async function control(action) {
  if (QUESTIONS[action] && !(await confirmed(QUESTIONS[action]))) return;
  at("answer").textContent = `asking to ${action} …`;
  try {
    const response = await fetch(`control/${action}`, {
      method: "POST",
      headers: { "X-Stepdiag-Token": token },
    });
    const answer = await response.json();
    at("answer").textContent = answer.done ? answer.text : `not done: ${answer.text}`;
  } catch {
    at("answer").textContent = `no contact: whether ${action} was done is not known`;
  }
}

for (const button of document.querySelectorAll("#controls button")) {
  button.addEventListener("click", () => control(button.dataset.action));
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.repeat || at("confirm").open) return;
  if (/^[1-9]$/.test(event.key)) {
    const section = document.querySelectorAll("main section")[Number(event.key) - 1];
    section.tabIndex = -1;
    section.focus();
    section.scrollIntoView({ block: "start" });
    return;
  }
  const button = [...document.querySelectorAll("#controls button")].find(
    (one) => one.dataset.action[0] === event.key,
  );
  if (button && !button.disabled && !at("controls").hidden) button.click();
});

setInterval(watch, 500);
connect();
