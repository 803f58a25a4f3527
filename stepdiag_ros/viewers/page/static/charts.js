// The plots, by uPlot. Each is made once and given new data; none keeps what it was given before.
const uPlot = window.uPlot;
const at = (id) => document.getElementById(id);
const charts = new Map(); // element → { plot, make }

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

function axes(x, y) {
  const look = () => colour("soft");
  const grid = { stroke: () => colour("grid"), width: 1 };
  const font = "11px system-ui, sans-serif";
  return [
    { label: x, labelSize: 16, labelFont: font, size: 24, stroke: look, grid, font, ticks: { show: false } },
    { label: y, labelSize: 16, labelFont: font, size: 44, stroke: look, grid, font, ticks: { show: false } },
  ];
}

function show(place, options, data) {
  let chart = charts.get(place);
  if (!chart) {
    const size = { width: place.clientWidth || 300, height: place.clientHeight || 150 };
    const plot = new uPlot(
      { ...size, cursor: { show: false }, legend: { show: false }, scales: { x: { time: false } }, ...options },
      data, place,
    );
    chart = { plot };
    charts.set(place, chart);
    sizes.observe(place);
  } else {
    chart.plot.setData(data);
  }
  return chart.plot;
}

const sizes = new ResizeObserver((changes) => {
  for (const { target } of changes) {
    const plot = charts.get(target)?.plot;
    const [width, height] = [target.clientWidth, target.clientHeight];
    if (plot && width && (width !== plot.width || height !== plot.height)) plot.setSize({ width, height });
  }
});

// The colours are read again when the look of the computer changes.
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const { plot } of charts.values()) plot.redraw();
});

// Of a plot without data uPlot draws no axes; a tiny range around zero shows that there are no data.
const range = (_, low, high) => {
  if (low == null || high == null) return [-1, 1];
  const margin = Math.max((high - low) * 0.1, 0.05);
  return [low - margin, high + margin];
};

export function drawStops(trace) {
  const columns = [0, 1, 2].map((i) => trace.map((one) => one[i]));
  show(at("stop-chart"), {
    axes: axes("stop", "off by, µm"),
    scales: { x: { time: false }, y: { range } },
    series: [
      {},
      { stroke: () => colour("soft"), width: 1.5, dash: [4, 3], points: { show: false } },
      { stroke: () => colour("blue"), width: 2, points: { size: 4 } },
    ],
  }, columns);
}

const MARKS = { X: ["blue", "square"], Y: ["orange", "circle"], Z: ["purple", "triangle"] };

function mark(ctx, shape, x, y, size, hollow) {
  ctx.beginPath();
  if (shape === "circle") ctx.arc(x, y, size, 0, 2 * Math.PI);
  else if (shape === "square") ctx.rect(x - size, y - size, 2 * size, 2 * size);
  else {
    ctx.moveTo(x, y - size * 1.2);
    ctx.lineTo(x + size * 1.2, y + size);
    ctx.lineTo(x - size * 1.2, y + size);
    ctx.closePath();
  }
  if (hollow) ctx.stroke();
  else ctx.fill();
}

let shownBlocks = { blocks: [], before: [] };
const COVERAGE = 1.96; // U = 1.96 u, 95 %

function drawMarks(plot) {
  const { ctx } = plot;
  const scale = devicePixelRatio;
  ctx.save();
  for (const [list, hollow] of [[shownBlocks.before, true], [shownBlocks.blocks, false]]) {
    for (const [where, axis, value, u] of list) {
      if (value == null) continue;
      const [name, shape] = MARKS[axis] ?? ["green", "circle"];
      ctx.fillStyle = ctx.strokeStyle = colour(name);
      ctx.lineWidth = 1.2 * scale;
      const [x, y] = [plot.valToPos(where, "x", true), plot.valToPos(value, "y", true)];
      if (u != null && !hollow) {
        ctx.beginPath();
        ctx.moveTo(x, plot.valToPos(value - COVERAGE * u, "y", true));
        ctx.lineTo(x, plot.valToPos(value + COVERAGE * u, "y", true));
        ctx.stroke();
      }
      mark(ctx, shape, x, y, 3.5 * scale, hollow);
    }
  }
  // Which shape is which axis.
  ctx.font = `${11 * scale}px system-ui, sans-serif`;
  ctx.textBaseline = "middle";
  ctx.textAlign = "left";
  const axesShown = [...new Set(shownBlocks.blocks.map((one) => one[1]))].sort();
  axesShown.forEach((axis, number) => {
    const [name, shape] = MARKS[axis] ?? ["green", "circle"];
    ctx.fillStyle = ctx.strokeStyle = colour(name);
    const x = plot.bbox.left + (12 + 34 * number) * scale;
    const y = plot.bbox.top + 8 * scale;
    mark(ctx, shape, x, y, 3.5 * scale, false);
    ctx.fillText(axis, x + 8 * scale, y);
  });
  ctx.restore();
}

export function drawBlocks(blocks, before) {
  shownBlocks = { blocks, before };
  const all = [...blocks, ...before].sort((a, b) => a[0] - b[0]);
  show(at("blocks-chart"), {
    axes: axes("stop of the line, from its start", "µm"),
    scales: { x: { time: false, range: (_, low, high) => (low == null ? [0, 1] : [Math.min(0, low - 0.5), high + 0.5]) }, y: { range } },
    series: [{}, { stroke: "transparent", points: { show: false }, paths: () => null }],
    hooks: { draw: [drawMarks] },
  }, [all.map((one) => one[0]), all.map((one) => one[2])]);
}

const sum = (a, b, sign) => a.map((value, i) => (value == null || b[i] == null ? null : value + sign * b[i]));

export function drawCurves(curves) {
  const grid = at("curve-grid");
  if (!curves.length) {
    for (const place of grid.querySelectorAll(".chart")) forget(place);
    grid.replaceChildren();
    return;
  }
  curves.forEach((curve, number) => {
    let figure = grid.children[number];
    if (!figure) {
      figure = grid.appendChild(document.createElement("div"));
      figure.className = "curve";
      const [head, place] = [document.createElement("h3"), document.createElement("div")];
      place.className = "chart";
      figure.append(head, place);
    }
    figure.dataset.name = curve.name;
    const [head, place] = figure.children;
    const known = curve.known !== "none";
    const last = curve.values.findLast((value) => value != null);
    head.textContent = curve.name + { all: "", part: ": partly unknown", none: ": unknown" }[curve.known];
    head.className = known ? "" : "unknown";
    place.dataset.values = JSON.stringify(curve.values);
    place.setAttribute("role", "img");
    place.setAttribute("aria-label", known ? `${curve.name}, at the last known node ${last} µm` : `${curve.name} unknown`);
    show(place, {
      axes: axes(`${curve.axis}, mm`, "µm"),
      scales: { x: { time: false }, y: { range } },
      series: [
        {},
        { stroke: () => colour("blue"), width: 2, points: { size: 5 } },
        { stroke: () => colour("blue"), width: 0.7, dash: [3, 3], points: { show: false } },
        { stroke: () => colour("blue"), width: 0.7, dash: [3, 3], points: { show: false } },
      ],
      bands: [{ series: [2, 3], fill: () => `${colour("blue")}2e` }],
    }, [curve.positions, curve.values, sum(curve.values, curve.uncertainty, 1), sum(curve.values, curve.uncertainty, -1)]);
  });
  while (grid.children.length > curves.length) {
    forget(grid.lastChild.querySelector(".chart"));
    grid.lastChild.remove();
  }
}

function forget(place) {
  charts.get(place)?.plot.destroy();
  charts.delete(place);
  sizes.unobserve(place);
}
