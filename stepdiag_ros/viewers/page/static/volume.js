// The measured box and the lines through it, seen from above its front corner.
const NS = "http://www.w3.org/2000/svg";
const svg = document.getElementById("volume-drawing");
const MARGIN = 26;
const [WIDTH, HEIGHT] = [320, 240];
let project = null; // mm of the machine → place in the drawing
let courses = [];
let lines = [];
let block = null;
let tool = null;

function make(name, className, parent = svg) {
  const element = document.createElementNS(NS, name);
  element.setAttribute("class", className);
  parent.append(element);
  return element;
}

const path = (points) => "M" + points.map((one) => project(one).map((v) => v.toFixed(1)).join(" ")).join("L");

// Places that do not follow each other: a short stroke each.
const dots = (points) => points.map((one) => project(one)).map(([x, y]) => `M${x - 1.5} ${y}L${x + 1.5} ${y}`).join("");

// X to the right, Y away to the upper right, Z up.
const flat = ([x, y, z]) => [x + 0.55 * y, -z - 0.4 * y];

function fit(box, stations) {
  const corners = stations.map((one) => flat(one.at));
  for (let i = 0; i < 8; i += 1) corners.push(flat([box[i & 1][0], box[(i >> 1) & 1][1], box[i >> 2][2]]));
  const [xs, ys] = [corners.map((c) => c[0]), corners.map((c) => c[1])];
  const [left, top] = [Math.min(...xs), Math.min(...ys)];
  const scale = Math.min(
    (WIDTH - 2 * MARGIN) / (Math.max(...xs) - left || 1),
    (HEIGHT - 2 * MARGIN) / (Math.max(...ys) - top || 1),
  );
  return (point) => {
    const [x, y] = flat(point);
    return [MARGIN + (x - left) * scale, MARGIN + (y - top) * scale];
  };
}

export function drawVolume(told) {
  svg.replaceChildren();
  svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  [courses, lines, block, tool, project] = [told.courses, [], null, null, null];
  document.getElementById("course-list").replaceChildren();
  if (!told.box) return;
  const box = told.box;
  const stations = told.stations ?? [];
  project = fit(box, stations);
  const corner = (i) => [box[i & 1][0], box[(i >> 1) & 1][1], box[i >> 2][2]];
  for (let i = 0; i < 8; i += 1) {
    for (const bit of [1, 2, 4]) {
      if (!(i & bit)) make("path", "edge").setAttribute("d", path([corner(i), corner(i | bit)]));
    }
  }
  ["X", "Y", "Z"].forEach((name, axis) => {
    const label = make("text", "");
    const [x, y] = project(corner(1 << axis));
    label.setAttribute("x", x + 4);
    label.setAttribute("y", y + (axis === 2 ? -4 : 12));
    label.textContent = name;
  });
  lines = courses.map((course) => {
    const line = make("path", "course left");
    line.setAttribute("d", course.places ? dots(course.path) : path(course.path));
    return line;
  });
  for (const station of stations) {
    const [x, y] = project(station.at);
    make("path", "station").setAttribute("d", `M${x} ${y - 6}L${x + 6} ${y + 5}L${x - 6} ${y + 5}Z`);
    const label = make("text", "");
    label.setAttribute("x", x + 8);
    label.setAttribute("y", y + 4);
    label.textContent = station.name;
  }
  block = make("path", "present-block");
  tool = make("circle", "tool");
  tool.setAttribute("r", 5);
  tool.setAttribute("visibility", "hidden");
}

const WORDS = { left: "left", present: "present", measured: "measured", incomplete: "incomplete" };

export function drawProgress(told) {
  if (!project) return;
  const list = document.getElementById("course-list");
  told.courses.forEach((one, number) => {
    if (!lines[number]) return;
    lines[number].setAttribute("class", `course ${one.look}`);
    let item = list.children[number];
    if (!item) item = list.appendChild(document.createElement("li"));
    item.className = one.look;
    item.dataset.look = one.look;
    item.textContent = `${courses[number].name} ${one.done}/${courses[number].passes} ${WORDS[one.look]}`;
  });
  // What is being measured lies above the rest.
  const present = lines.filter((line, number) => told.courses[number]?.look === "present");
  for (const line of present) svg.insertBefore(line, block);
  block.setAttribute("d", told.block ? path(told.block) : "");
}

export function drawTool(place) {
  if (!project || !tool) return;
  tool.setAttribute("visibility", place ? "visible" : "hidden");
  if (!place) return;
  const [x, y] = project(place);
  tool.setAttribute("cx", x.toFixed(1));
  tool.setAttribute("cy", y.toFixed(1));
}
