"use strict";
// Unpacks Plotly, arranges the panels of each figure by the width of the page, and keeps a picture in light colours of
// each figure for the printer. `document.documentElement.dataset.ready` becomes `drawn`, then `printable`.
(() => {
const root = document.documentElement;
const scale = colours => colours.map((colour, i) => [i / (colours.length - 1), colour]);
const LIGHT = {ink: "#1d2127", grey: "#8a8f98", paper: "#ffffff", veil: "rgba(255,255,255,0.75)", card: "#f5f7fa", grid: "#e3e6eb",
  sizes: scale(["#1f4fa8", "#5b3fb0", "#a32f9c", "#d8495f", "#f08a1d"])};
const DARK = {ink: "#e6e8ec", grey: "#8a919e", paper: "#14171c", veil: "rgba(20,23,28,0.75)", card: "#1e232b", grid: "#2d333d",
  sizes: scale(["#6d8fe0", "#9f7fe6", "#dc72c4", "#f58a7a", "#ffd24d"]), cover: 1.8,
  instead: {"#3b7dd8": "#6ea8f7", "#d9700a": "#f29a45", "#4e9a06": "#85cc3f", "#d4372c": "#ff8073", "#8a8f98": "#a8aeb9",
    "#1d4f9c": "#5b90e6", "#a1440d": "#dd7d40", "#2f6b3c": "#5fb57b"}};
// `sizes`: colours from zero to the largest value, all of them visible on the paper. `instead`: brighter ones for thin lines
// on dark paper; `cover`: factor of the opacity of dots there.
const LEAST = {xy: 250, polar: 330, scene: 300};  // px, least width of a panel
const PRINTED = {width: 900, height: 0.9, scene: 0.65};  // px, width of a figure for the printer; share of the height of its panels and scenes
const GAP = {left: 62, right: 16, top: 12, bottom: 46, title: 22, scale: 66};
const BUTTONS = {least: 560, width: 110, high: 30}; // px: least width of a figure with buttons, and their size, top right
const FONT = 12;

const system = window.matchMedia("(prefers-color-scheme: dark)");
const isDark = () => root.dataset.theme ? root.dataset.theme === "dark" : system.matches;

function coloured(value, palette) {
  if (typeof value === "string") return value[0] === "@" && palette[value.slice(1)] || (palette.instead || {})[value] || value;
  if (Array.isArray(value)) return typeof value[0] === "number" && typeof value[1] !== "string" ? value : value.map(each => coloured(each, palette));
  if (value && typeof value === "object")
    return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, key === "opacity" && typeof each === "number"
      ? Math.min(1, (palette.cover || 1) * each) : coloured(each, palette)]));
  return value;
}

function merged(base, over) {
  const result = {...base};
  for (const [key, value] of Object.entries(over || {}))
    result[key] = value && typeof value === "object" && !Array.isArray(value) ? merged(base[key], value) : value;
  return result;
}

// Names of the legend, each once, and the height of its lines, px.
function legend(panels, width) {
  const names = new Set(panels.flatMap(panel => panel.traces.filter(trace => trace.name && trace.showlegend !== false)
    .map(trace => trace.name)));
  if (names.size === 0) return {shown: false, height: 0};
  const widest = Math.max(...[...names].map(name => 46 + name.length * FONT * 0.58));
  const inRow = Math.max(1, Math.floor((width - 20) / widest));
  return {shown: true, height: 10 + 20 * Math.ceil(names.size / inRow)};
}

// Lines of at most so many px.
function wrapped(text, width, size) {
  const most = Math.max(8, Math.floor(width / (size * 0.58))), lines = [""];
  for (const word of String(text || "").split(" ")) {
    const longer = lines.at(-1) ? `${lines.at(-1)} ${word}` : word;
    if (longer.length <= most || !lines.at(-1)) lines[lines.length - 1] = longer; else lines.push(word);
  }
  return lines.join("<br>");
}

// Height of the lines below the first one, px.
const more = text => 16 * (text.split("<br>").length - 1);

// An axis with names for ticks: as many of them, evenly spread, as have room side by side in this width, px.
function thinned(own, width) {
  if (!own || !own.ticktext) return own;
  const longest = Math.max(...own.ticktext.map(text => text.length)), room = Math.max(2, Math.floor(width / (FONT * (0.58 * longest + 1.5))));
  const every = Math.ceil(own.ticktext.length / room), kept = values => values.filter((_, i) => i % every === 0);
  return {...own, tickvals: kept(own.tickvals), ticktext: kept(own.ticktext)};
}

function axis(palette, own, title) {
  const plain = {gridcolor: palette.grid, zerolinecolor: palette.grey, linecolor: palette.grey, zerolinewidth: 1,
    title: {text: title || "", standoff: 6}, automargin: false, exponentformat: "power", minexponent: 5};
  return merged(plain, own);
}

const SIGHT = {right: [0.739, 0.674, 0], up: [-0.246, 0.269, 0.931], toViewer: [0.627, -0.688, 0.364]};
const TAN = Math.tan(Math.PI / 8);                // of half the angle of view from top to bottom
const ROOM = {across: 90, narrow: 74, top: 26, bottom: 42};   // px, of the labels of a scene
const SLACK = 1.08;                                // share of the distance for lines and cones at the edges of a box
const NARROW = 420;                                // px, width below which a scene has fewer ticks and small labels
const CAPTION = 30, LEAST_HIGH = 170;             // px, of the title of a scene with its gaps; least height of a scene

const along = (point, direction) => point[0] * direction[0] + point[1] * direction[1] + point[2] * direction[2];

// Coordinates of the tips of cones, whose tails are at their points.
const tips = (trace, name, vector) => trace.type === "cone" ? trace[name].map((at, i) => at + trace.sizeref * trace[vector][i]) : [];

// Ends of the axes of a scene: those of its points and of the tips of its cones, with a margin for the bases of cones.
function endsOf(traces) {
  const margin = traces.some(trace => trace.type === "cone") ? 0.1 : 0.04;
  const ends = [["x", "u"], ["y", "v"], ["z", "w"]].map(([name, vector]) =>
    traces.flatMap(trace => [...[trace[name] || []].flat(2), ...tips(trace, name, vector)]).filter(Number.isFinite)
    .reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]))
    .map(([low, high]) => low <= high ? [low, high] : [0, 0]);
  const longest = Math.max(...ends.map(([low, high]) => high - low)) || 20;
  return ends.map(([low, high]) => {
    const more = Math.max(margin * (high - low), 0.05 * longest - (high - low) / 2);
    return [low - more, high + more];
  });
}

// Camera before a box of these half sides, which fills with its labels an area of this size, px: the distance from the
// centre of the box, and the shifts to the right and up. A shift fits between its limits of two corners if the distance is
// at least half of the sum of their depths, plus half of their difference across over the tangent of the angle of view.
function sight(half, width, height) {
  const free = {right: TAN * width / height * Math.max(0.3, 1 - 2 * (width < NARROW ? ROOM.narrow : ROOM.across) / width),
    up: TAN * Math.max(0.3, 1 - (ROOM.top + ROOM.bottom) / height)};
  const corners = [...Array(8).keys()].map(corner => half.map((length, k) => corner >> k & 1 ? length : -length));
  const depths = corners.map(point => along(point, SIGHT.toViewer)), found = {away: 0};
  const offsets = name => corners.map(point => along(point, SIGHT[name]));
  for (const name of ["right", "up"]) offsets(name).forEach((one, i, all) => all.forEach((other, j) => {
    found.away = Math.max(found.away, (one - other) / (2 * free[name]) + (depths[i] + depths[j]) / 2);
  }));
  found.away *= SLACK;
  for (const name of ["right", "up"]) {
    const all = offsets(name), room = depths.map(depth => free[name] * (found.away - depth));
    found[name] = (Math.max(...all.map((each, i) => each - room[i])) + Math.min(...all.map((each, i) => each + room[i]))) / 2;
  }
  found.up -= (ROOM.bottom - ROOM.top) / height * TAN * found.away;
  return found;
}

// Least width, px, of an area of this height in which a box of these half sides is as large as in one of the given width.
function snug(half, width, height) {
  const away = sight(half, width, height).away;
  let least = width;
  while (least - 10 >= LEAST.scene && sight(half, least - 10, height).away <= away) least -= 10;
  return least;
}

const halves = sides => sides.map(side => 0.5 * side / Math.cbrt(sides[0] * sides[1] * sides[2]));

// Camera of a scene of this size, px: as near as its box with these sides, and the labels around it, allow.
function camera(sides, width, height) {
  const found = sight(halves(sides), width, height), names = ["x", "y", "z"];
  const at = distance => Object.fromEntries(names.map((name, k) =>
    [name, distance * SIGHT.toViewer[k] + found.right * SIGHT.right[k] + found.up * SIGHT.up[k]]));
  return {center: at(0), eye: at(found.away)};
}

// Height of a row of scenes, px: the least at which all of them are about as large as in the greatest.
function sceneHeight(panels, width, most) {
  const half = panels.map(panel => halves(endsOf(panel.traces).map(([low, high]) => high - low)));
  const sizes = height => half.map(each => (height - CAPTION) / sight(each, width - 12, height - CAPTION).away);
  const full = sizes(most);
  let high = most;
  while (high - 10 >= LEAST_HIGH && sizes(high - 10).every((size, i) => size >= 0.97 * full[i])) high -= 10;
  return high;
}

// Height of a panel, px: labels of several lines above bars make it higher.
function roomy(panel, width, height, printed) {
  if (!(panel.axes || {}).bare) return (printed ? PRINTED.height : 1) * height;
  const lines = Math.max(...(panel.notes || []).map(note => noted(note, width).split("<br>").length));
  return Math.max(height, lines > 1 ? 70 + (14 * lines + 3) / 0.58 * panel.notes.length : 0);
}

// Text of a label above a bar, in lines.
const noted = (note, width) => wrapped(note.text, width - 12, FONT - 1);

// Panel `i` in its cell (px: x0, x1 from the left, y0, y1 from the top) of a figure of this size.
function place(layout, panel, i, cell, size, palette, spec, across) {
  const kind = panel.kind, own = panel.axes || {}, tools = size.buttons && cell.y0 <= BUTTONS.high && cell.x1 >= size.width - 1 ? BUTTONS.width : 0;
  const left = kind === "xy" ? GAP.left : 8;
  const title = wrapped(panel.title, cell.x1 - cell.x0 - left - tools, FONT * 1.08);
  const label = wrapped(panel.x, cell.x1 - cell.x0 - 20, FONT + 2);
  const top = cell.y0 + (panel.title ? GAP.title + more(title) : 0);
  if (panel.title) layout.annotations.push({text: `<b>${title}</b>`, align: "left", showarrow: false, xref: "paper", yref: "paper",
    x: (cell.x0 + left) / size.width, y: 1 - cell.y0 / size.height, xanchor: "left",
    yanchor: "top", font: {size: FONT}});
  const n = i ? i + 1 : "", bare = own.bare;
  const box = kind === "xy"
    ? {x: [cell.x0 + (bare ? 6 : GAP.left), cell.x1 - GAP.right], y: [cell.y1 - GAP.bottom - more(label), top + GAP.top]}
    : {x: kind === "polar" ? [cell.x0 + 28, cell.x1 - 28] : [cell.x0 + 6, cell.x1 - 6], y: [cell.y1 - (kind === "polar" ? 26 : 4), top + (kind === "polar" ? 22 : 4)]};
  const domain = {x: box.x.map(x => Math.min(Math.max(x / size.width, 0), 1)),
    y: box.y.map(y => Math.min(Math.max(1 - y / size.height, 0), 1))};
  if (kind === "scene") {
    const ends = endsOf(panel.traces), sides = ends.map(([low, high]) => high - low);
    const height = box.y[0] - box.y[1], width = snug(halves(sides), box.x[1] - box.x[0], height);
    const middle = (box.x[0] + box.x[1]) / 2;
    domain.x = [middle - width / 2, middle + width / 2].map(x => x / size.width);
    const most = (width < NARROW ? 4 : 6) / Math.max(...sides);  // ticks of a length
    const plain = {backgroundcolor: palette.card, showbackground: true, title: {font: {size: FONT}}};
    const side = (name, k) => merged(axis(palette, {...plain, range: ends[k],
      nticks: Math.max(2, Math.round(most * sides[k]))}, panel[name]), own[`${name}axis`]);
    layout[`scene${n}`] = merged({domain, xaxis: side("x", 0), yaxis: side("y", 1), zaxis: side("z", 2), aspectmode: "data",
      dragmode: "turntable", camera: camera(sides, width, height)}, own.scene);
  } else if (kind === "polar") {
    layout[`polar${n}`] = merged({domain, bgcolor: palette.paper, angularaxis: axis(palette), radialaxis: axis(palette)}, own.polar);
  } else {
    const x = axis(palette, thinned(own.xaxis, box.x[1] - box.x[0]), label);
    const y = axis(palette, own.yaxis, wrapped(panel.y, cell.y1 - top - 30, FONT + 2));
    if (spec.sameX && i) x.matches = "x";
    if (spec.sameY && i) y.matches = "y";
    layout[`xaxis${n}`] = {...x, domain: domain.x, anchor: `y${n}`};
    layout[`yaxis${n}`] = {...y, domain: domain.y, anchor: `x${n}`};
    for (const note of panel.notes || []) {
      const xref = note.xref === "domain" ? `x${n} domain` : `x${n}`;
      const text = bare ? noted(note, cell.x1 - cell.x0) : note.text;
      layout.annotations.push({showarrow: false, bgcolor: bare ? "" : palette.veil, borderpad: 1, font: {size: FONT - 1}, yref: `y${n}`, align: "left", ...note, text, xref});
    }
    for (const shape of panel.shapes || [])
      layout.shapes.push({yref: `y${n}`, ...shape, xref: shape.xref === "domain" ? `x${n} domain` : `x${n}`,
        ...(shape.yref === "domain" ? {yref: `y${n} domain`} : {})});
  }
}

// Data and layout of a figure at this width, px, on the screen or for the printer.
function arranged(spec, width, palette, printed = false) {
  const panels = spec.panels.map(panel => ({kind: "xy", traces: [], ...panel}));
  const least = Math.max(...panels.map(panel => LEAST[panel.kind]));
  const most = Math.max(1, Math.min(spec.across, Math.floor(width / least)));
  const down = Math.ceil(panels.length / most), across = Math.ceil(panels.length / down);
  const names = legend(panels, width), flat = panels.some(panel => panel.kind !== "scene");
  const high = flat ? Math.max(...panels.map(panel => roomy(panel, width / across, spec.height, printed)))
    : sceneHeight(panels, width / across, Math.min((printed ? PRINTED.scene : 1) * spec.height, Math.max(300, 0.85 * width / across)));  // a narrow scene is not high
  const size = {width, buttons: !printed && width >= BUTTONS.least, height: names.height + down * high + (spec.colours ? GAP.scale : 0)};
  const layout = {width, height: size.height, margin: {l: 0, r: 0, t: 0, b: 0, autoexpand: false}, paper_bgcolor: palette.paper,
    plot_bgcolor: palette.paper, font: {color: palette.ink, size: FONT, family: "system-ui, 'DejaVu Sans', sans-serif"},
    annotations: [], shapes: [], showlegend: names.shown, bargap: 0.35, hovermode: "closest",
    dragmode: window.matchMedia("(pointer: coarse)").matches ? false : "zoom",
    legend: {orientation: "h", x: 0.5, xanchor: "center", y: 1, yanchor: "top", bgcolor: "rgba(0,0,0,0)", itemsizing: "constant"}};
  const data = [], seen = new Set();
  panels.forEach((panel, i) => {
    const column = i % across, row = Math.floor(i / across);
    const cell = {x0: column * width / across, x1: (column + 1) * width / across,
      y0: names.height + row * high, y1: names.height + (row + 1) * high};
    place(layout, panel, i, cell, size, palette, spec, across);
    const n = i ? i + 1 : "";
    const where = {scene: {scene: `scene${n}`}, polar: {subplot: `polar${n}`}, xy: {xaxis: `x${n}`, yaxis: `y${n}`}}[panel.kind];
    for (const trace of panel.traces) {
      const named = Boolean(trace.name) && trace.showlegend !== false;
      const small = panel.kind === "scene" && trace.text && width / across < NARROW ? {textfont: {...trace.textfont, size: FONT - 3}} : {};
      data.push({hoverlabel: {namelength: -1}, ...trace, ...small, ...where, legendgroup: trace.name || `${i}`,
        showlegend: named && !seen.has(trace.name)});
      if (named) seen.add(trace.name);
    }
  });
  if (spec.colours) {
    const {title, ...own} = spec.colours;
    layout.coloraxis = {...own, colorbar: {orientation: "h", x: 0.5, xanchor: "center", len: Math.min(0.9, 420 / width),
      y: 8 / size.height, yanchor: "bottom", thickness: 10, outlinewidth: 0, title: {text: title, side: "top", font: {size: FONT}}, ypad: 2,
      tickfont: {size: FONT - 1}}};
  }
  const edges = [...Array(down).keys()].slice(1).map(row => names.height + row * high);  // px, between rows of panels
  return {...coloured({data, layout}, palette), edges: [0, ...edges, size.height]};
}

const CONFIG = {displaylogo: false, responsive: false, displayModeBar: "hover", showTips: false,
  plotGlPixelRatio: window.devicePixelRatio || 1,
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]]};
const CONFIG_3D = {...CONFIG, modeBarButtons: [["toImage", "orbitRotation", "tableRotation", "resetCameraDefault3d"]]};
const is3d = spec => spec.panels.some(panel => panel.kind === "scene");
const configOf = spec => is3d(spec) ? CONFIG_3D : CONFIG;
const next = () => new Promise(resolve => setTimeout(resolve));

async function draw(plot, spec) {
  const width = Math.floor(plot.clientWidth);
  if (!width) return;  // inside a closed <details>
  plot.shownWidth = width;
  const {data, layout} = arranged(spec, width, isDark() ? DARK : LIGHT);
  await Plotly.react(plot, data, layout, {...configOf(spec), ...(width < BUTTONS.least ? {displayModeBar: false} : {})});
}

async function picture(plot, spec) {
  const {data, layout, edges} = arranged(spec, PRINTED.width, LIGHT, true);
  const solid = is3d(spec), printed = document.createElement("div");
  const source = await Plotly.toImage({data, layout, config: {plotGlPixelRatio: 1.5}},
    {format: solid ? "png" : "svg", scale: solid ? 1.5 : 1, width: layout.width, height: layout.height});
  printed.className = "printed";
  for (let row = 1; row < edges.length; row++) {  // a page may end between two rows of panels
    const strip = document.createElement("div"), image = document.createElement("img");
    strip.className = "strip";
    strip.style.aspectRatio = `${layout.width} / ${edges[row] - edges[row - 1]}`;
    image.style.transform = `translateY(${-100 * edges[row - 1] / layout.height}%)`;
    image.alt = row > 1 ? "" : plot.getAttribute("aria-label");
    image.src = source;
    strip.append(image);
    printed.append(strip);
    await image.decode();
  }
  plot.after(printed);
}

async function unpacked(id) {
  const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), each => each.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).text();
}

async function all() {
  const text = document.getElementById("figures");
  if (!text) { root.dataset.ready = "printable"; return; }
  const script = document.createElement("script");
  script.textContent = await unpacked("library");
  document.head.append(script);
  const figures = JSON.parse(text.textContent);
  const plots = [...document.querySelectorAll(".plot")];
  const specOf = plot => figures[Number(plot.dataset.figure)];
  const redraw = () => plots.forEach(plot => draw(plot, specOf(plot)));
  for (const plot of plots) { await draw(plot, specOf(plot)); await next(); }
  root.dataset.ready = "drawn";
  system.addEventListener("change", redraw);
  root.addEventListener("theme", redraw);
  new ResizeObserver(() => plots.forEach(plot => {
    if (plot.clientWidth && Math.floor(plot.clientWidth) !== plot.shownWidth) draw(plot, specOf(plot));
  })).observe(document.body);
  document.addEventListener("toggle", () => plots.forEach(plot => { if (!plot.shownWidth) draw(plot, specOf(plot)); }), true);
  for (const plot of plots) { await picture(plot, specOf(plot)); await next(); }
  root.dataset.ready = "printable";
}

// A browser breaks a line behind a hyphen too: the words of a command stay whole.
for (const command of document.querySelectorAll(".command dd")) {
  const words = command.textContent.split(" ").map(text => Object.assign(document.createElement("span"), {textContent: text}));
  command.replaceChildren(...words.flatMap(word => [word, " "]));
}
const button = document.getElementById("theme");
button.hidden = false;
button.addEventListener("click", () => {
  root.dataset.theme = isDark() ? "light" : "dark";
  root.dispatchEvent(new Event("theme"));
});
const closed = [];
window.addEventListener("beforeprint", () => {
  for (const each of document.querySelectorAll("details:not([open])")) { closed.push(each); each.open = true; }
});
window.addEventListener("afterprint", () => { for (const each of closed.splice(0)) each.open = false; });
if (parent !== window)  // in the frame of a page that cannot look into this one
  new ResizeObserver(() => parent.postMessage({height: root.offsetHeight}, "*")).observe(root);
all().catch(fault => {
  root.dataset.ready = "failed";
  root.dataset.fault = String(fault && fault.message || fault);
  const line = document.createElement("p");
  line.className = "fault";
  line.textContent = `The figures cannot be drawn (${root.dataset.fault}). Open the page in a browser of 2023 or later.`;
  document.querySelector("main").prepend(line);
  console.error(fault);
});
})();
