"use strict";
// Rows are made in chunks, and only near what is seen: a fleet may have thousands of machines.
const CHUNK = 10;
const NEAR = "1200px";
const page = JSON.parse(document.getElementById("machines").textContent);
const table = document.getElementById("fleet");
const filter = document.getElementById("filter");
const today = new Date().toISOString().slice(0, 10);
const open = new Set();
const chosen = new Set();
let shown = page.machines.map((_, number) => number);
let selected = 0;
let rowHeight = 56;

function element(tag, attributes, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

function small(text, more = "") {
  return text ? element("span", { class: `small ${more}` }, text) : "";
}

function late(machine) {
  return page.every !== null && (machine.due === "" || machine.due < today);
}

// Visits: what this page shows is kept, and the next page is compared with it.
const KEY = `stepdiag fleet ${page.place}`;

function signature(machine) {
  return [machine.runs, machine.state, machine.outlook, machine.changed];
}

function visits() {
  const now = { made: page.made, machines: {} };
  for (const one of page.machines) now.machines[one.name] = signature(one);
  try {
    const kept = JSON.parse(localStorage.getItem(KEY) || "{}");
    const before = kept.seen && kept.seen.made !== page.made ? kept.seen : kept.before;
    localStorage.setItem(KEY, JSON.stringify({ before, seen: now }));
    return before || null;
  } catch {
    return null;
  }
}

const before = visits();
const COLUMNS = before ? 7 : 6;

function news(machine) {
  if (!before) return [];
  const then = before.machines[machine.name];
  if (!then) return ["new machine"];
  const [runs, state, outlook, changed] = then;
  const more = machine.runs - runs;
  return [
    more > 0 ? `${more} new run${more > 1 ? "s" : ""}` : "",
    state !== machine.state ? `was ${page.states[state].word}` : "",
    outlook !== machine.outlook ? `was: ${outlook}` : "",
    changed !== machine.changed && machine.changed ? machine.changed : "",
  ].filter(Boolean);
}

function picture(machine) {
  const { days, sizes, band, tolerance } = machine;
  if (!sizes.length) return small("unknown");
  const [width, height, edge, next] = [100, 30, 2, 8];
  const top = Math.max(...sizes, band[1] ?? 0);
  const highest = (tolerance !== null && tolerance < 4 * top ? Math.max(top, tolerance) : top) || 1;
  const x = (day) => edge + ((width - 2 * edge - next) * day) / (days.at(-1) || 1);
  const y = (size) => height - edge - ((height - 2 * edge) * Math.max(size, 0)) / highest;
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const add = (name, attributes) => {
    const part = document.createElementNS(svg.namespaceURI, name);
    for (const [key, value] of Object.entries(attributes)) part.setAttribute(key, value);
    svg.append(part);
    return part;
  };
  const label = `${sizes.length} runs in ${days.at(-1)} days: ${sizes[0]} to ${sizes.at(-1)} µm`;
  for (const [key, value] of [["viewBox", `0 0 ${width} ${height}`], ["role", "img"],
    ["preserveAspectRatio", "none"], ["aria-label", label]]) svg.setAttribute(key, value);
  add("title", {}).textContent = label;
  if (band[1] !== null) {
    const [upper, lower] = [y(band[1]), y(band[0])];
    add("rect", { class: "limits", x: width - next, width: next, y: upper, height: lower - upper });
  }
  if (tolerance !== null && tolerance <= highest) {
    add("line", { class: "tolerance", x1: 0, x2: width, y1: y(tolerance), y2: y(tolerance) });
  }
  const points = sizes.map((size, number) => `${x(days[number]).toFixed(1)} ${y(size).toFixed(1)}`);
  const end = sizes.length === 1 ? `M${edge} ${y(sizes[0])}h4` : `M${points.join("L")}`;
  add("path", { class: "line", d: end });
  return svg;
}

function row(number) {
  const machine = page.machines[number];
  const state = page.states[machine.state];
  const name = element("button", { type: "button", "aria-expanded": open.has(number),
    tabindex: number === shown[selected] ? 0 : -1 }, machine.name);
  const due = page.every === null || late(machine) ? "" : `due ${machine.due}`;
  const overdue = late(machine) ? (machine.due ? `overdue since ${machine.due}` : "overdue") : "";
  return element("tr", { class: `machine ${state.tone}`, "data-number": number },
    element("td", {}, name, small(machine.serial)),
    element("td", {}, element("span", { class: "state" }, state.word), small(machine.beside),
      small(machine.verdict)),
    element("td", {}, machine.last || "date unknown", small(overdue || due, overdue && "late")),
    element("td", { class: "n" }, element("span", { class: "size" }, machine.worst),
      small(machine.limit && `of ${machine.limit} µm`)),
    element("td", {}, picture(machine)),
    element("td", {}, machine.outlook, small(machine.changed)),
    ...(before ? [element("td", {}, ...news(machine).map((one) => element("b", {}, one)))] : []));
}

// As a POSIX shell reads it.
function quoted(text) {
  return /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", `'"'"'`)}'`;
}

function report([date, run, verdict, worst, link, bag, several]) {
  if (link) return element("a", { href: link }, "report");
  if (!bag) return "the bag is not in the archive any more";
  // A report is made of a file on this computer.
  if (!page.local) return element("code", {}, `${page.root}/${bag}`);
  const safe = /^[\w.-]+$/.test(run) && !/^\.+$/.test(run);
  const command = [
    `stepdiag report ${quoted(`${page.root}/${bag}`)} --html`,
    several && run ? `--run ${quoted(run)}` : "",
    safe ? `--output ${quoted(`${page.root}/${page.reports}/${run}`)}` : "",
  ].filter(Boolean).join(" ");
  return element("details", {}, element("summary", {}, "make the report"),
    element("code", {}, command));
}

function list(title, texts) {
  if (!texts.length) return [];
  return [element("h3", {}, title),
    element("ul", {}, ...texts.map((text) => element("li", {}, text)))];
}

function rows(kind, heads, cells) {
  const head = element("tr", {}, ...heads.map((one) => element("th", {}, one)));
  const body = cells.map((line) => element("tr", {}, ...line.map((cell, column) =>
    element("td", heads[column] ? { "data-name": heads[column] } : {}, cell))));
  return element("div", { class: "wide" }, element("table", { class: kind },
    element("thead", {}, head), element("tbody", {}, ...body)));
}

let lines = null;
let remarks = null;

function details(number) {
  lines ??= document.getElementById("details").textContent.trim().split("\n");
  remarks ??= JSON.parse(document.getElementById("remarks").textContent);
  const one = JSON.parse(lines[number]);
  const machine = page.machines[number];
  const figures = one.figures.map(([name, unit, ...rest]) =>
    [unit ? `${name} / ${unit}` : name, ...rest]);
  const left = machine.runs - one.runs.length;
  const runs = element("div", {}, element("h3", {}, "Runs, newest first"),
    rows("runs", ["date, UTC", "run", "verdict", "largest error, µm", "report"], one.runs.map((run) =>
      [run[0] || "unknown", run[1] || "without identity", run[2], run[3], report(run)])),
    left ? small(`${left} older runs: stepdiag archive list ${quoted(page.place)} --machine `
      + quoted(machine.name)) : "");
  const rest = element("div", {},
    ...list("Against tolerances (ISO 14253-1)", one.judged),
    ...(figures.length ? [element("h3", {}, "Figures over the years"),
      rows("figures", ["figure", "now ± U", "a year ± U", "outside"], figures)] : []),
    ...list("Changes, newest first", one.changes),
    ...list("Unknown", one.unknown),
    ...list("Limits of these statements", one.remarks.map((at) => remarks[at])));
  const cell = element("td", { colspan: COLUMNS },
    element("div", { class: "inside" }, runs, rest));
  return element("tr", { class: "more" }, cell);
}

// Chunks of rows.
const near = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) isIntersecting ? fill(target) : empty(target);
}, { rootMargin: `${NEAR} 0px` });

function numbers(chunk) {
  const first = Number(chunk.dataset.chunk) * CHUNK;
  return shown.slice(first, first + CHUNK);
}

function fill(chunk) {
  if (chunk.dataset.filled) return;
  chunk.dataset.filled = "yes";
  chunk.replaceChildren(...numbers(chunk).flatMap((number) =>
    open.has(number) ? [row(number), details(number)] : [row(number)]));
}

function empty(chunk) {
  const height = chunk.dataset.filled
    ? chunk.getBoundingClientRect().height : numbers(chunk).length * rowHeight;
  delete chunk.dataset.filled;
  chunk.replaceChildren(element("tr", { class: "space" },
    element("td", { colspan: COLUMNS, style: `height: ${height}px` })));
}

function layOut() {
  near.disconnect();
  for (const body of [...table.tBodies]) body.remove();
  for (let chunk = 0; chunk * CHUNK < shown.length; chunk += 1) {
    const body = element("tbody", { "data-chunk": chunk });
    table.append(body);
    if (chunk === 0) {
      fill(body);
      rowHeight = body.rows[0].getBoundingClientRect().height || rowHeight;
    } else empty(body);
    near.observe(body);
  }
  document.getElementById("nothing").hidden = shown.length > 0;
}

// Filter.
const texts = [];

function matches(number, words) {
  const machine = page.machines[number];
  for (const choice of chosen) if (!choice.test(machine)) return false;
  texts[number] ??= [machine.name, machine.serial, machine.verdict, machine.outlook,
    machine.changed, page.states[machine.state].word].join("\n").toLowerCase();
  return words.every((word) => texts[number].includes(word));
}

function sift() {
  const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
  shown = [];
  for (let number = 0; number < page.machines.length; number += 1) {
    if (matches(number, words)) shown.push(number);
  }
  selected = 0;
  layOut();
}

function choices() {
  const all = page.states.map(({ word }, state) => [word, (one) => one.state === state]);
  if (page.every !== null) all.push(["overdue", late]);
  if (before) all.push(["new", (one) => news(one).length > 0]);
  for (const [word, test] of all) {
    const count = page.machines.filter(test).length;
    if (!count || count === page.machines.length) continue;
    const choice = { test };
    const button = element("button", { type: "button", "aria-pressed": "false" }, `${word} ${count}`);
    button.addEventListener("click", () => {
      if (!chosen.delete(choice)) chosen.add(choice);
      button.setAttribute("aria-pressed", chosen.has(choice));
      sift();
    });
    document.getElementById("choices").append(button);
  }
}

function lastVisit() {
  if (!before) return;
  const when = before.made.slice(0, 16).replace("T", " ");
  table.tHead.rows[0].append(element("th", {}, `New since ${when} UTC`));
  const button = element("button", { type: "button" }, "Mark all as seen");
  button.addEventListener("click", () => {
    const kept = JSON.parse(localStorage.getItem(KEY));
    localStorage.setItem(KEY, JSON.stringify({ seen: kept.seen }));
    location.reload();
  });
  document.getElementById("visit").append(button);
}

// Selection.
function rowOf(number) {
  return table.querySelector(`tr[data-number="${number}"]`);
}

function select(place, focus = true) {
  if (!shown.length) return;
  rowOf(shown[selected])?.querySelector("button").setAttribute("tabindex", -1);
  selected = Math.min(Math.max(place, 0), shown.length - 1);
  fill(table.tBodies[Math.floor(selected / CHUNK)]);
  const button = rowOf(shown[selected]).querySelector("button");
  button.setAttribute("tabindex", 0);
  if (focus) button.focus();
}

function toggle(number) {
  const line = rowOf(number);
  if (open.delete(number)) line.nextElementSibling.remove();
  else {
    open.add(number);
    line.after(details(number));
  }
  line.querySelector("button").setAttribute("aria-expanded", open.has(number));
}

table.addEventListener("click", (event) => {
  const line = event.target.closest("tr.machine");
  if (!line) return;
  select(shown.indexOf(Number(line.dataset.number)));
  toggle(Number(line.dataset.number));
});

filter.addEventListener("input", sift);

const MOVES = { ArrowDown: 1, ArrowUp: -1, PageDown: 10, PageUp: -10, Home: -Infinity, End: Infinity };

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const typing = event.target === filter;
  if (event.key === "/" && !typing) filter.focus();
  else if (event.key === "Escape") {
    if (typing && filter.value) {
      filter.value = "";
      sift();
    } else if (open.has(shown[selected])) toggle(shown[selected]);
    select(selected);
  } else if (typing && (event.key === "Enter" || event.key === "ArrowDown")) select(0);
  else if (event.key in MOVES && !typing) {
    select(table.contains(document.activeElement) ? selected + MOVES[event.key] : 0);
  } else return;
  event.preventDefault();
});

addEventListener("beforeprint", () => [...table.tBodies].forEach(fill));
addEventListener("afterprint", layOut);

table.hidden = false;
document.getElementById("tools").hidden = false;
lastVisit();
choices();
layOut();
