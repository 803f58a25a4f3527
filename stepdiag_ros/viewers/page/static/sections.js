// Writes each section of the state into its place on the page. Numbers come as texts, with their
// units; what is not known comes as "unknown". Only texts are set, never HTML.
import { drawBlocks, drawCurves, drawStops } from "./charts.js";
import { drawProgress, drawTool, drawVolume } from "./volume.js";

const at = (id) => document.getElementById(id);

function say(id, text) {
  const place = at(id);
  const told = text ?? "";
  if (place.textContent !== told) place.textContent = told;
}

function badge(id, text, look) {
  say(id, text);
  at(id).className = `badge ${look}`;
}

function pairs(id, rows) {
  at(id).replaceChildren(
    ...rows.flatMap(([name, text, key]) => {
      const [term, value] = [document.createElement("dt"), document.createElement("dd")];
      [term.textContent, value.textContent] = [name, text];
      if (key) value.dataset.name = key;
      return [term, value];
    }),
  );
}

function list(id, items) {
  at(id).replaceChildren(
    ...items.map(([text, look]) => {
      const item = document.createElement("li");
      item.textContent = text;
      if (look) item.className = look;
      return item;
    }),
  );
}

const LOOKS = {
  RUNNING: "busy", FINISHED: "good", FAULT: "bad", ABORTED: "bad",
  PAUSED: "care", WAITING_FOR_SETUP: "care",
};

function run(told) {
  badge("run-state", told.words, LOOKS[told.state] ?? "");
  say("run-text", told.text === told.words ? "" : told.text);
  const bar = at("run-progress");
  if (told.share == null) bar.removeAttribute("value");
  else bar.value = told.share;
  at("run-progress").hidden = told.share == null;
  say("run-stops", told.stops_total ? `${told.stops_done} of ${told.stops_total} stops` : "");
  say("run-remaining", told.remaining || "–");
  say("headline-remaining", told.remaining || "–");
  for (const part of document.getElementsByClassName("of-target")) part.hidden = !told.target;
  say("run-target", told.target || "");
  at("target-progress").hidden = told.target_share == null;
  at("target-progress").value = told.target_share ?? 0;
  say("run-line", told.line ? `${told.line} (${told.line_number} of ${told.line_count})` : "–");
  const block = told.block_count ? `block ${told.block} of ${told.block_count}, ` : "";
  const where = `${block}stop ${told.stop} (0 to ${told.stop_count - 1})`;
  say("run-block", told.line ? where : "–");
  say("run-plan", told.plan + (told.simulated ? " (simulated machine)" : ""));
  say("run-id", told.run_id);
  say("refused-start", told.refused_start && `Nothing can be started: ${told.refused_start}.`);
  document.title = told.share == null ? "stepdiag" : `${Math.floor(told.share * 100)} % ${told.words} – stepdiag`;
}

const SIGNS = { fault: "✖ ", warning: "▲ ", starting: "… " };
let saidFaults = "";

function faults(told) {
  const rows = told.faults.map((one) => [`${SIGNS[one.level]}${one.who}: ${one.text}`, one.level]);
  if (told.more) rows.push([`and ${told.more} more`, "warning"]);
  const starting = told.starting.map((one) => [`${SIGNS.starting}${one.who} is starting: ${one.text}`, "note"]);
  rows.push(...starting);
  if (told.note) rows.push([`– ${told.note}`, "note"]);
  else if (!rows.length) rows.push(["✔ no faults reported", ""]);
  // A list that is written again is read out again.
  const said = JSON.stringify(rows);
  if (said !== saidFaults) list("fault-list", rows);
  saidFaults = said;
}

function position(told) {
  const text = Object.entries(told.texts).map(([axis, where]) => `${axis} ${where}`).join(", ");
  say("position", told.at ? text : `position ${told.words}`);
  drawTool(told.at);
}

function progress(told) {
  drawProgress(told);
}

const BEAMS = { good: ["✔ good", "good"], dim: ["▲ dim", "care"], lost: ["✖ lost", "bad"] };

function beam(told) {
  const [word, look] = BEAMS[told.state] ?? ["", ""];
  badge("beam-state", word, look);
  say("beam-words", told.words);
  at("beam-meter").hidden = told.strength == null;
  at("beam-meter").value = told.strength ?? 0;
  say("beam-percent", told.percent);
  say("beam-reading", told.reading ?? "unknown");
}

function stop(told) {
  const last = told.last;
  const where = last ? `${last.line}, stop ${last.stop}, ${last.readings} readings` : "none yet";
  say("stop-where", last && !last.settled ? `${where}: rejected, ${last.reason}` : where);
  for (const name of ["displacement", "nominal", "from_nominal", "expected", "from_expected"]) {
    say(`stop-${name.replace("_", "-")}`, last ? (last[name] ?? "unknown") : "");
  }
  say("stop-by", last?.zero_known === false
    ? "The first stop of this setup is missing: values relative to it are unknown."
    : last?.note
    ? `${last.note} Counted from the first stop of the station.`
    : last?.expected_by
    ? `Expected by ${last.expected_by} from the passes so far. Counted from the first stop of the setup.`
    : "The passes so far do not predict this stop. Counted from the first stop of the setup.");
  drawStops(told.trace);
}

function blocks(told) {
  say("blocks-line", told.line || "none yet");
  const last = told.last;
  say("blocks-last", last ? `block ${last.block} ${last.axis}: ${last.displacement}, off by ${last.deviation}` : "");
  drawBlocks(told.blocks, told.before);
}

function curves(told) {
  const by = `${told.method}, from ${told.lines} passes`;
  const drawn = told.curves.length ? `${by}; band: U (95 %)` : `${by}: it tells no curves`;
  say("curves-method", told.method ? drawn : "no result yet");
  list("curves-unknown", [...told.not_determined, ...told.remarks].map((text) => [text]));
  at("curves-unknown").parentElement.hidden = !told.not_determined.length && !told.remarks.length;
  drawCurves(told.curves);
}

function squareness(told) {
  pairs("squareness-list", told.figures.map((one) => [`${one.name}, ${one.words}`, one.text, one.name]));
}

function worst(told) {
  const which = told.curve ? `Largest value of ${told.curve} so far` : "Largest error so far";
  say("worst-what", which);
  say("worst-text", told.text);
  say("worst-where", told.where && `(${told.limit ? "U so far at most, " : "U so far, "}95 %) at ${told.where}`);
}

const VERDICTS = { CONSISTENT: "good", NAMED: "care", AMBIGUOUS: "care", UNEXPLAINED: "bad" };

function verdict(told) {
  badge("verdict-word", told.verdict ?? "", VERDICTS[told.verdict] ?? "");
  const lines = told.verdict == null ? "" : `${told.lines} of ${told.lines_planned} passes`;
  const soFar = told.verdict == null || told.final ? "" : ` so far (${lines})`;
  // What a part of the lines shows is no result yet, and looks like none.
  const look = soFar ? "" : VERDICTS[told.verdict] ?? "";
  badge("headline-verdict", (told.verdict ?? "no verdict yet") + soFar, look);
  say("verdict-sentence", told.sentence);
  if (told.verdict == null) {
    for (const id of ["verdict-gap", "verdict-findings"]) at(id).replaceChildren();
    say("verdict-lines", "");
    return;
  }
  say("verdict-lines", lines + (told.final ? "" : ", so far"));
  const rows = [["gap, rms", told.gap.rms, "rms"], ["gap, largest", told.gap.largest, "largest"]];
  if (told.gap_left) rows.push(["with the findings, rms", told.gap_left.rms, "rms_left"]);
  pairs("verdict-gap", rows);
  const findings = told.findings.map((one) => [`${one.label}: ${one.sizes.join("; ")}`]);
  list("verdict-findings", [...findings, ...told.where.map((text) => [text, "small"])]);
}

function weather(told) {
  pairs("weather-list", told.values.map((one) => [one.name, one.text, one.name]));
}

export const SECTIONS = {
  run, faults, volume: drawVolume, progress, position, beam, stop, blocks, worst, curves,
  squareness, verdict, weather,
};
