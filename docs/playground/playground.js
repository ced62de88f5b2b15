'use strict';
/* The playground: a spring system that the visitor changes, and the results of the solver (solver.js, compiled from
 * playground.cpp). `problem` is the system, with its start, in the form of docs/system-json.md; all that is shown follows
 * from it and the method. */
(() => {
const $ = (id) => document.getElementById(id);
const METHODS = [['ida', 'IDA'], ['ncg', 'nonlinear CG'], ['lbfgs', 'L-BFGS'], ['newton', 'Newton']];
const STAIRCASE = 4;
const MAX_ITERATIONS = 10000, MAX_NODES = 400, MAX_LINKS = 8000;
const TURN = [0.6, -0.35];
const FRAME = 8;  // ms of a frame for tasks that can wait
const copy = (value) => JSON.parse(JSON.stringify(value));
const median = (values) => values.length ? [...values].sort((a, b) => a - b)[values.length >> 1] : 1;
const format = (v) => v === Infinity ? '∞' : !Number.isFinite(v) ? '–' : v === 0 ? '0'
  : Math.abs(v) >= 1e-3 && Math.abs(v) < 1e5 ? String(Number(v.toPrecision(6))) : v.toExponential(4);

// --- The solver ---------------------------------------------------------------------------------------------------

/** The functions of playground.h over one system at a time. */
class Solver {
  constructor(module) {
    this.module = module;
    const name = (f, i) => module.UTF8ToString(module[`_asterism_playground_${f}`](i));
    this.status = (i) => name('status', i);
    this.proof = (i) => name('proof', i);
    METHODS.forEach(([id], i) => { if (name('method', i) !== id) throw Error(`solver.js has another method ${i} than ${id}`); });
  }

  call(f, ...more) { return this.module[`_asterism_playground_${f}`](this.handle, ...more); }
  view(which) {
    const start = this.call('array', which) / 8;
    return this.module.HEAPF64.subarray(start, start + this.call('count', which));
  }
  message() { return this.module.UTF8ToString(this.call('message')); }

  /** Takes the values of a system; makes a new one first if the number of nodes or the links differ. */
  set(problem) {
    const links = problem.links.flat(), n = problem.anchors.length, key = [problem.dim, n, ...links].join();
    if (key !== this.key) {
      if (this.handle) this.call('delete');
      const ends = this.module._malloc(4 * Math.max(1, links.length));
      this.module.HEAP32.set(links, ends / 4);
      this.handle = this.module._asterism_playground_new(problem.dim, n, problem.links.length, ends);
      this.module._free(ends);
      this.key = key;
      this.fixed = [];
    }
    this.view(0).set(problem.anchors.flat());
    this.view(1).set(problem.anchor_stiffness);
    this.view(2).set(problem.rest_length);
    this.view(3).set(problem.link_stiffness);
    const fixed = problem.fixed || [];
    for (const i of this.fixed) if (!fixed.includes(i)) this.call('fix', i, 0);
    for (const i of fixed) this.call('fix', i, 1);
    this.fixed = fixed.slice();
  }

  /** x is flat. Positions of the iterates are in `path`, the given x first. */
  solve(method, x, tolerance, withPath = true) {
    this.view(4).set(x);
    const status = this.call('solve', method, tolerance, MAX_ITERATIONS);
    const [, iterations, , , , , first, energy, bound, norm, stationarity, definite, seconds] = this.view(7);
    const records = this.view(5), energies = [];
    for (let i = 0; i < records.length; i += 3) {
      // The staircase solves several times: only the last one is drawn.
      if (records[i] === 0) energies.length = 0;
      energies.push([records[i], records[i + 1], records[i + 2]]);
    }
    const solverName = this.module.UTF8ToString(this.call('solver'));
    return {status: this.status(status), usable: [1, 2, 3, 7].includes(status), iterations, first, energy, bound, norm, stationarity,
      definite, seconds, energies, message: this.message(), solver: solverName,
      x: Float64Array.from(this.view(4)), path: withPath ? Float64Array.from(this.view(6)) : null};
  }

  certify(x) {
    this.view(4).set(x);
    const proof = this.proof(this.call('certify'));
    const [, energy, bound, eigenvalue, distance] = this.view(8);
    return {proof, energy, bound, eigenvalue, distance, reason: this.message()};
  }

  covariances(x) {
    this.view(4).set(x);
    return this.call('covariances') ? {blocks: Float64Array.from(this.view(9))} : {reason: this.message()};
  }

  /** The grid: its first point, the step to the next column, that to the next row. */
  landscape(x, node, grid, columns, rows) {
    this.view(4).set(x);
    this.view(11).set(grid.flat());
    this.call('landscape', node, columns, rows);
    return Float64Array.from(this.view(10));
  }
}

// --- Systems as JSON: docs/system-json.md -------------------------------------------------------------------------

const KEYS = ['asterism_system', 'name', 'origin', 'dim', 'anchors', 'anchor_stiffness', 'anchor_shape', 'links', 'rest_length',
  'link_stiffness', 'fixed', 'start'];

/** The first system of a file, or an Error that names what is wrong. */
function readSystem(text) {
  let value;
  try {
    value = JSON.parse(text);
  } catch (error) {  // JSON lines
    const line = text.split('\n').find((l) => l.trim());
    if (!line) throw Error('the file holds no system');
    try { value = JSON.parse(line); } catch { throw Error(`not JSON: ${error.message}`); }
  }
  if (Array.isArray(value)) value = value[0];
  return checkSystem(value);
}

function checkSystem(value) {
  const refuse = (text) => { throw Error(text); };
  if (value === null || typeof value !== 'object' || Array.isArray(value)) refuse('expected a system, an object');
  for (const key of Object.keys(value)) if (!KEYS.includes(key)) refuse(`unknown key ${key}`);
  for (const key of ['asterism_system', 'dim', 'anchors', 'anchor_stiffness', 'links', 'rest_length', 'link_stiffness'])
    if (!(key in value)) refuse(`${key} is missing`);
  if (value.asterism_system !== 1) refuse('asterism_system: this page reads version 1');
  if (value.dim !== 2 && value.dim !== 3) refuse('dim: this page shows systems of the plane and of space, of dim 2 or 3');
  if ('anchor_shape' in value) refuse('anchor_shape: this page does not show anisotropic anchors');
  const list = (key, count, what) => {
    if (!Array.isArray(value[key])) refuse(`${key}: expected an array`);
    if (count !== undefined && value[key].length !== count) refuse(`${key}: expected ${count} (${what}), found ${value[key].length}`);
    return value[key];
  };
  const number = (v, place) => typeof v === 'number' && Number.isFinite(v) ? v : refuse(`${place}: expected a number`);
  const amounts = (key, count, what) => list(key, count, what).forEach((v, i) =>
    number(v, `${key}[${i}]`) >= 0 || refuse(`${key}[${i}] is negative`));
  const points = (key, count) => list(key, count, 'one a node').forEach((p, i) =>
    Array.isArray(p) && p.length === value.dim ? p.forEach((v, c) => number(v, `${key}[${i}][${c}]`)) : refuse(`${key}[${i}]: expected ${value.dim} numbers`));
  points('anchors');
  const n = value.anchors.length;
  if (n === 0) refuse('anchors is empty');
  if (n > MAX_NODES) refuse(`${n} nodes: this page takes ${MAX_NODES} at most`);
  const node = (v, place) => Number.isInteger(v) && v >= 0 && v < n ? v : refuse(`${place}: node ${v} is out of range (${n} nodes)`);
  amounts('anchor_stiffness', n, 'one a node');
  list('links').forEach((l, i) => {
    if (!Array.isArray(l) || l.length !== 2) refuse(`links[${i}]: expected 2 nodes`);
    l.forEach((v, c) => node(v, `links[${i}][${c}]`));
    if (l[0] === l[1]) refuse(`links[${i}] joins a node to itself`);
  });
  if (value.links.length > MAX_LINKS) refuse(`${value.links.length} links: this page takes ${MAX_LINKS} at most`);
  amounts('rest_length', value.links.length, 'one a link');
  amounts('link_stiffness', value.links.length, 'one a link');
  if ('fixed' in value) list('fixed').forEach((v, i) => node(v, `fixed[${i}]`));
  if ('start' in value) points('start', n);
  if ('name' in value && typeof value.name !== 'string') refuse('name: expected a text');
  if ('origin' in value && (value.origin === null || typeof value.origin !== 'object' || Array.isArray(value.origin))) refuse('origin: expected an object');
  return {...copy(value), fixed: [...(value.fixed || [])], start: copy(value.start || value.anchors)};
}

/** In the form of the library's writer, which leaves out an empty `fixed`. */
function writeSystem(p) {
  const out = {};
  for (const key of KEYS) if (key in p && !(key === 'fixed' && p.fixed.length === 0)) out[key] = p[key];
  return JSON.stringify(out);
}

// --- What there is to show ----------------------------------------------------------------------------------------

let solver, problem, preset = null;
let view = {scale: 1, x: 0, y: 0};
let turn = [0, 0];             // of a system in space: the angles about the vertical axis and about the screen's horizontal one
let centre = [0, 0];           // the point that it is turned about
let axes = [[1, 0], [0, 1]];   // the directions to the right, downwards and, in space, away from the viewer
let fitted = {};               // the view that fit() made
let selected = {kind: 'node', index: 0}, linkFrom = -1;
let shown = null;              // the chosen method's solve, with certificate and covariances
let all = [];                  // the solves of all methods
let second = null;             // the staircase's result
let held = null;               // a part under the pointer: {index, x of all parts}
let at = Infinity;             // the number of the iterate that is shown
let tasks = [], isDirty = true, isStale = true, playing = 0;
let landscape = null, bounds = null;
let reference = {link: 1, anchor: 1, size: 1};
const past = [];
const times = [];              // of frames with a solve [ms], for the tests
const method = () => $('method').selectedIndex;
const tolerance = () => Number($('tolerance').value);
const flat = (points) => points.flat();
const pointOf = (x, i) => Array.from(x.slice(problem.dim * i, problem.dim * (i + 1)));
const pointsOf = (x) => Array.from({length: x.length / problem.dim}, (_, i) => pointOf(x, i));
const distance = (x, i, j) => Math.hypot(...pointOf(x, i).map((v, c) => v - x[problem.dim * j + c]));
/** The ranges of points' coordinates. */
const boxOf = (points) => points[0].map((_, c) => { const v = points.map((p) => p[c]); return [Math.min(...v), Math.max(...v)]; });

function solveShown() {
  const p = held ? {...problem, fixed: [...problem.fixed, ...(problem.fixed.includes(held.index) ? [] : [held.index])]} : problem;
  solver.set(p);
  shown = solver.solve(method(), held ? held.x : flat(problem.start), tolerance());
  if (held && shown.usable) held.x = Array.from(shown.x);
  if (held && shown.usable) holdThere();
  const start = held ? null : flat(problem.start);
  shown.steps = shown.path.length / shown.x.length;
  shown.start = start;
  at = Infinity;
  all = []; bounds = null; landscape = null; second = null;
  const usable = shown.usable;
  shown.certificate = usable && !held ? solver.certify(shown.x) : null;
  shown.covariances = usable && $('show-ellipses').checked ? solver.covariances(shown.x) : null;
  // Other results are computed in the spare time of later frames.
  tasks = [];
  if (wantsLandscape()) tasks.push(mapLandscape);
  if (!held) {
    METHODS.forEach((_, i) => tasks.push(() => { all[i] = i === method() ? shown : solver.solve(i, flat(problem.start), tolerance(), false); isDirty = true; }));
    tasks.push(startBounds);
  }
}

const holdThere = () => held.at.forEach((v, c) => { held.x[problem.dim * held.index + c] = v; });

// Computes the lower bound at the iterates of the chosen method, at about 120 of them at most.
function startBounds() {
  if (!shown.usable) return;
  const count = shown.steps, every = Math.max(1, Math.ceil(count / 120));
  bounds = [];
  for (let i = 0; i < count + every - 1; i += every) {
    const k = Math.min(i, count - 1);
    tasks.push(() => { bounds.push([shown.energies[k][0], solver.certify(iterate(k)).bound]); isDirty = true; });
  }
}

function iterate(k) {
  const size = shown.x.length;
  if (!shown.steps || k >= shown.steps - 1 && k === Infinity) return shown.x;
  const i = Math.min(k, shown.steps - 1);
  return i === shown.steps - 1 && shown.steps === shown.energies.length ? shown.x : shown.path.subarray(size * i, size * (i + 1));
}
const position = () => at === Infinity ? shown.x : iterate(at);

function wantsLandscape() { return $('show-landscape').checked && selected && selected.kind !== 'link' && selected.index < problem.anchors.length; }

function mapLandscape() {
  if (!wantsLandscape()) return;
  const {width, height} = size(), cell = Math.max(3, Math.ceil(Math.sqrt(width * height / 25000)));
  const columns = Math.ceil(width / cell) + 1, rows = Math.ceil(height / cell) + 1;
  const step = cell / view.scale, near = pointOf(position(), selected.index);
  const grid = [toWorld(0, 0, near), ...axes.slice(0, 2).map((axis) => axis.map((v) => step * v))];
  const energies = solver.landscape(position(), selected.index, grid, columns, rows);
  const picture = document.createElement('canvas');
  picture.width = columns; picture.height = rows;
  const pixels = new ImageData(columns, rows), color = rgb('--accent');
  let least = Infinity, most = 0;
  for (const e of energies) { least = Math.min(least, e); most = Math.max(most, e); }
  // 14 levels, in equal ratios above the least energy.
  const floor = (most - least) * 1e-4;
  energies.forEach((e, i) => {
    const share = Math.log((e - least + floor) / floor) / Math.log((most - least + floor) / floor || 1);
    const level = Math.floor(14 * share) / 14;
    pixels.data.set([...color, 200 * (1 - level) ** 1.2], 4 * i);
  });
  picture.getContext('2d').putImageData(pixels, 0, 0);
  landscape = {picture, left: view.x, top: view.y, width: columns * step, height: rows * step, step};
  isDirty = true;
}

// --- Drawing ------------------------------------------------------------------------------------------------------

const canvas = $('view');
let colors = {};
const color = (name) => colors[name] || (colors[name] = getComputedStyle(document.documentElement).getPropertyValue(name).trim());
const rgb = (name) => [1, 3, 5].map((i) => parseInt(color(name).slice(i, i + 2), 16));
const size = () => ({width: canvas.clientWidth, height: canvas.clientHeight});
/** Node `i` of a flat x along an axis, from the centre. */
const along = (axis, x, i = 0) => axis.reduce((sum, v, c) => sum + v * (x[axis.length * i + c] - centre[c]), 0);
const toScreen = (x, i = 0) => [(along(axes[0], x, i) - view.x) * view.scale, (along(axes[1], x, i) - view.y) * view.scale];
/** The point at a place of the screen, in space as far away as `near`. */
function toWorld(sx, sy, near) {
  const steps = [sx / view.scale + view.x, sy / view.scale + view.y, ...axes.slice(2).map((axis) => along(axis, near))];
  return centre.map((v, c) => v + steps.reduce((sum, step, a) => sum + step * axes[a][c], 0));
}
function turnTo(yaw, pitch) {
  turn = [yaw, Math.max(-Math.PI / 2, Math.min(Math.PI / 2, pitch))];
  const [c, s, d, t] = turn.flatMap((v) => [Math.cos(v), Math.sin(v)]);
  axes = problem.dim === 2 ? [[1, 0], [0, 1]] : [[c, 0, -s], [s * t, d, c * t], [s * d, -t, c * d]];
  landscape = null;
  redo(); keepState();
}
const turnBy = (dx, dy) => turnTo(turn[0] + 0.01 * dx, turn[1] - 0.01 * dy);

function prepare(target) {
  const ratio = window.devicePixelRatio || 1, width = target.clientWidth, height = target.clientHeight;
  if (target.width !== Math.round(width * ratio) || target.height !== Math.round(height * ratio)) {
    target.width = Math.round(width * ratio); target.height = Math.round(height * ratio);
  }
  const pen = target.getContext('2d');
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return {pen, width, height};
}

function fit() {
  const points = [...($('show-anchors').checked ? problem.anchors.filter((_, i) => problem.anchor_stiffness[i] > 0) : []), ...problem.start, ...(shown ? pointsOf(shown.x) : []), ...(second ? pointsOf(second.x) : [])];
  let [[left, right], [top, bottom]] = boxOf(points);
  centre = axes.map(() => 0);
  if (problem.dim === 3) {  // a ball, which is in view however it is turned
    centre = boxOf(points).map(([low, high]) => (low + high) / 2);
    right = bottom = Math.max(...points.map((p) => Math.hypot(...p.map((v, c) => v - centre[c]))));
    left = top = -right;
  }
  const {width, height} = size(), margin = Math.min(width, height) * 0.1;
  const wide = Math.max(right - left, 1e-9 * Math.max(1, Math.abs(left))), high = Math.max(bottom - top, 1e-9);
  view.scale = Math.min((width - 2 * margin) / wide, (height - 2 * margin) / high);
  if (!(view.scale > 0 && Number.isFinite(view.scale))) view.scale = 1;
  view.x = (left + right) / 2 - width / 2 / view.scale;
  view.y = (top + bottom) / 2 - height / 2 / view.scale;
  reference.size = Math.max(wide, high);
  fitted = {...view};
  redo();
}
/** Another size of the window keeps everything in view, unless the user has chosen a view. */
function resized() {
  const isFitted = ['scale', 'x', 'y'].every((key) => view[key] === fitted[key]);
  if (isFitted && !pointer) fit(); else redo();
}
function redo() { if (wantsLandscape() && shown) { tasks = [mapLandscape, ...tasks.filter((t) => t !== mapLandscape)]; } isDirty = true; }

function draw() {
  const {pen, width, height} = prepare(canvas);
  if (!shown) return;
  const x = position(), n = problem.anchors.length;
  const point = (i) => toScreen(x, i);
  const radius = n > 60 ? 4 : n > 20 ? 6 : 8;
  // In space, from -1 (near) to 1: what is far is drawn first, paler and smaller.
  const depths = Array.from({length: n}, (_, i) => problem.dim === 3 ? Math.max(-1, Math.min(1, 2 * along(axes[2], x, i) / reference.size)) : 0);
  const fade = (depth) => problem.dim === 3 ? 0.7 - 0.3 * depth : 1;
  const farFirst = (count, depth) => Array.from({length: count}, (_, i) => i).sort((a, b) => depth(b) - depth(a));
  const depthOfLink = (l) => (depths[problem.links[l][0]] + depths[problem.links[l][1]]) / 2;
  if (landscape && wantsLandscape()) {
    const left = (landscape.left - landscape.step / 2 - view.x) * view.scale, top = (landscape.top - landscape.step / 2 - view.y) * view.scale;
    pen.imageSmoothingEnabled = true;
    pen.drawImage(landscape.picture, left, top, landscape.width * view.scale, landscape.height * view.scale);
  }
  const anchor = (i) => toScreen(problem.anchors[i]);
  if ($('show-anchors').checked) {
    pen.strokeStyle = pen.fillStyle = color('--anchor');
    for (let i = 0; i < n; ++i) {
      if (!(problem.anchor_stiffness[i] > 0)) continue;
      const [ax, ay] = anchor(i), [px, py] = point(i);
      pen.globalAlpha = 0.7; pen.lineWidth = 1; pen.setLineDash([3, 3]);
      line(pen, ax, ay, px, py);
      pen.setLineDash([]); pen.globalAlpha = 1;
      const r = radius * 0.75;
      pen.lineWidth = 1.5; pen.strokeRect(ax - r, ay - r, 2 * r, 2 * r);
    }
  }
  if (second) {
    pen.strokeStyle = color('--second'); pen.lineWidth = 1.5; pen.setLineDash([5, 4]);
    for (const [i, j] of problem.links) line(pen, ...toScreen(second.x, i), ...toScreen(second.x, j));
    pen.setLineDash([]);
    for (let i = 0; i < n; ++i) circle(pen, ...toScreen(second.x, i), radius + 2, false);
  }
  // Links: colored by strain, as wide as they are stiff.
  const few = problem.links.length < 60;
  for (const l of farFirst(problem.links.length, depthOfLink)) {
    const [i, j] = problem.links[l], [ax, ay] = point(i), [bx, by] = point(j), mu = problem.rest_length[l];
    const r = distance(x, i, j);
    const strain = mu > 0 ? (r - mu) / mu : r > 0 ? 1 : 0;
    const wide = Math.max(-1.5, Math.min(2.5, Math.log10((problem.link_stiffness[l] || 1e-300) / reference.link)));
    const isSelected = selected && selected.kind === 'link' && selected.index === l;
    pen.lineWidth = (few ? 2.2 : 1.2) + 0.7 * wide + (isSelected ? 3 : 0);
    pen.strokeStyle = isSelected ? color('--accent') : color('--link');
    const opacity = fade(depthOfLink(l));
    pen.globalAlpha = (few ? 1 : 0.6) * opacity;
    line(pen, ax, ay, bx, by);
    if (!isSelected && Math.abs(strain) > 1e-3) {
      pen.globalAlpha = Math.min(1, 0.45 + 5 * Math.abs(strain)) * opacity;
      pen.strokeStyle = color(strain < 0 ? '--pushed' : '--pulled');
      line(pen, ax, ay, bx, by);
    }
    pen.globalAlpha = 1;
  }
  if (shown.covariances && shown.covariances.blocks && at === Infinity) {
    pen.strokeStyle = color('--node'); pen.fillStyle = color('--node'); pen.lineWidth = 1;
    for (let i = 0; i < n; ++i) {
      const [a, b, d] = projected(shown.covariances.blocks.subarray(problem.dim ** 2 * i, problem.dim ** 2 * (i + 1)));
      const mean = (a + d) / 2, off = Math.hypot((a - d) / 2, b);
      pen.beginPath();
      const most = 1e5 / view.scale;
      pen.ellipse(...point(i), 2 * Math.min(most, Math.sqrt(mean + off)) * view.scale, 2 * Math.min(most, Math.sqrt(Math.max(0, mean - off))) * view.scale,
        Math.atan2(2 * b, a - d) / 2, 0, 2 * Math.PI);
      if (2 * Math.sqrt(mean + off) * view.scale < 90) { pen.globalAlpha = n > 30 ? 0.05 : 0.1; pen.fill(); }
      pen.globalAlpha = 0.45; pen.stroke(); pen.globalAlpha = 1;
    }
  }
  if ($('show-path').checked && shown.start && shown.steps) {
    pen.strokeStyle = pen.fillStyle = color('--' + METHODS[method()][0]);
    const until = Math.min(at, shown.steps - 1);
    for (let i = 0; i < n; ++i) {
      pen.lineWidth = 1.5; pen.globalAlpha = 0.9;
      pen.beginPath();
      pen.moveTo(...toScreen(shown.start, i));
      for (let k = 0; k <= until; ++k) pen.lineTo(...toScreen(iterate(k), i));
      pen.stroke();
      if (n <= 30) {
        for (let k = 0; k <= Math.min(until, 200); ++k) circle(pen, ...toScreen(iterate(k), i), 2, true);
        pen.lineWidth = 1; circle(pen, ...toScreen(shown.start, i), radius * 0.6, false);
      }
      pen.globalAlpha = 1;
    }
  }
  for (const i of farFirst(n, (j) => depths[j])) {
    const [px, py] = point(i), isFixed = problem.fixed.includes(i), r = radius * (1 - 0.3 * depths[i]);
    pen.fillStyle = color('--node'); pen.strokeStyle = color('--ground'); pen.lineWidth = 1.5;
    if (isFixed) { pen.fillRect(px - r, py - r, 2 * r, 2 * r); pen.strokeRect(px - r, py - r, 2 * r, 2 * r); }
    else { circle(pen, px, py, r, true); circle(pen, px, py, r, false); }
  }
  pen.strokeStyle = color('--accent'); pen.lineWidth = 2.5;
  if (selected && selected.kind === 'node' && selected.index < n) circle(pen, ...point(selected.index), radius + 4, false);
  if (selected && selected.kind === 'anchor' && selected.index < n) { const [ax, ay] = anchor(selected.index); pen.strokeRect(ax - radius - 2, ay - radius - 2, 2 * radius + 4, 2 * radius + 4); }
  if (linkFrom >= 0 && linkFrom < n) {
    pen.setLineDash([6, 4]);
    const to = pointer && pointer.kind === 'link' ? pointer.screen : selected && selected.kind === 'node' ? point(selected.index) : null;
    if (to) line(pen, ...point(linkFrom), ...to);
    pen.setLineDash([]);
  }
  void width; void height;
}
/** xx, xy and yy of a symmetric matrix on the screen. */
function projected(matrix) {
  const product = (u, v) => u.reduce((sum, p, r) => v.reduce((t, q, c) => t + p * matrix[u.length * r + c] * q, sum), 0);
  return [product(axes[0], axes[0]), product(axes[0], axes[1]), product(axes[1], axes[1])];
}
function line(pen, ax, ay, bx, by) { pen.beginPath(); pen.moveTo(ax, ay); pen.lineTo(bx, by); pen.stroke(); }
function circle(pen, x, y, r, isFull) { pen.beginPath(); pen.arc(x, y, r, 0, 2 * Math.PI); if (isFull) pen.fill(); else pen.stroke(); }

/** Curves of [x, y] with y on a logarithmic scale. */
function chart(target, curves, title) {
  const {pen, width, height} = prepare(target);
  const points = curves.flatMap((c) => c.points).filter(([, y]) => y > 0);
  pen.font = '11px system-ui, sans-serif'; pen.fillStyle = color('--soft'); pen.textBaseline = 'top'; pen.textAlign = 'left';
  pen.fillText(title, 0, 0);
  if (!points.length) return;
  let low = Math.log10(Math.min(...points.map((p) => p[1]))), high = Math.log10(Math.max(...points.map((p) => p[1])));
  if (high - low < 0.05) { low -= 0.05; high += 0.05; }
  const most = Math.max(1, ...points.map((p) => p[0])), left = 46, top = 18, right = width - 14, bottom = height - 18;
  const X = (v) => left + (right - left) * Math.log1p(v) / Math.log1p(most), Y = (v) => bottom - (bottom - top) * (Math.log10(Math.max(v, 10 ** low)) - low) / (high - low);
  pen.strokeStyle = color('--line'); pen.lineWidth = 1;
  pen.textAlign = 'right'; pen.textBaseline = 'middle';
  const step = Math.max(1, Math.ceil((high - low) / 4));
  let drawn = 0;
  for (let e = Math.ceil(low / step) * step; e <= high; e += step, ++drawn) { line(pen, left, Y(10 ** e), right, Y(10 ** e)); pen.fillText(`1e${e}`, left - 4, Y(10 ** e)); }
  if (drawn < 2) for (const e of [low, high]) { line(pen, left, Y(10 ** e), right, Y(10 ** e)); pen.fillText(String(Number((10 ** e).toPrecision(3))), left - 4, Y(10 ** e)); }
  pen.textAlign = 'center'; pen.textBaseline = 'top';
  let last = -Infinity;
  for (const v of [0, 1, 3, 10, 30, 100, 300, 1000, 3000, 10000]) if (v <= most && X(v) - last > 24) { pen.fillText(String(v), X(v), bottom + 4); last = X(v); }
  for (const {points: list, color: c, wide, dash} of curves) {
    pen.strokeStyle = c; pen.lineWidth = wide ? 2.5 : 1.5; pen.setLineDash(dash || []);
    pen.beginPath();
    let isFirst = true;
    for (const [px, py] of list) { if (!(py > 0)) continue; if (isFirst) pen.moveTo(X(px), Y(py)); else pen.lineTo(X(px), Y(py)); isFirst = false; }
    pen.stroke(); pen.setLineDash([]);
  }
  if (at !== Infinity) { pen.strokeStyle = color('--accent'); line(pen, X(at), top, X(at), bottom); }
}

function drawCharts() {
  if (held || !shown) return;
  const solved = all.filter((s) => s && s.usable);
  const least = Math.min(...solved.map((s) => s.energy), second ? second.energy : Infinity);
  const floor = 1e-13 * Math.max(Math.abs(least), ...solved.map((s) => s.first * 1e-3));
  chart($('curves'), all.map((s, i) => s && s.usable && {points: s.energies.map(([k, e]) => [k, Math.max(e - least, floor)]), color: color('--' + METHODS[i][0]), wide: i === method()})
    .filter(Boolean), 'energy above the lowest found');
  if (!shown.usable) return chart($('bounds'), [], '');
  let best = 0;
  chart($('bounds'), [{points: shown.energies.map(([k, e]) => [k, e]), color: color('--' + METHODS[method()][0]), wide: true},
    {points: (bounds || []).map(([k, b]) => [k, best = Math.max(best, b)]), color: color('--bound'), dash: [5, 3], wide: true}], 'energy, and the best lower bound so far (dashed)');
}

function describe() {
  const rows = $('methods').tBodies[0];
  METHODS.forEach(([id, title], i) => {
    const row = rows.rows[i] || rows.insertRow(), s = all[i];
    if (!row.cells.length) {
      for (let c = 0; c < 4; ++c) row.insertCell();
      row.cells[0].innerHTML = `<span class="swatch" style="background: var(--${id})"></span>${title}`;
      row.onclick = () => { $('method').selectedIndex = i; changed(); };
    }
    row.className = i === method() ? 'chosen' : '';
    if (held) return;
    row.title = s ? `${s.solver}: ${s.status}${s.message ? ', ' + s.message : ''}` : '';
    row.cells[1].textContent = s ? (s.status === 'converged' ? s.iterations : `${s.iterations} (${s.status === 'maximum number of iterations' ? 'limit' : s.status})`) : '';
    row.cells[2].textContent = s ? format(s.energy) : '';
    row.cells[3].textContent = s ? s.seconds < 1e-4 ? '< 0.1' : (1000 * s.seconds).toFixed(s.seconds < 0.01 ? 1 : 0) : '';
  });
  const steps = shown.energies.length, k = Math.min(at, steps - 1);
  $('scrub').max = Math.max(0, steps - 1);
  $('scrub').value = Math.max(0, k);
  $('at').textContent = steps ? `${k} of ${steps - 1}` : '';
  if (held) { $('status').textContent = 'Part held: the others follow.'; return; }
  const name = METHODS[method()][1];
  $('status').textContent = !shown.usable ? `${name}: ${shown.status}: ${shown.message}`
    : at === Infinity ? `${name}: ${shown.status} after ${shown.iterations} iterations, energy ${format(shown.energy)}`
    : `${name}: iteration ${k}, energy ${format(shown.energies[k][1])}, gradient ${format(shown.energies[k][2])}`;
  const c = at === Infinity ? shown.certificate : certificateAt(k);
  const isProven = c && /global/.test(c.proof);
  $('proof').textContent = c ? c.proof[0].toUpperCase() + c.proof.slice(1) : '–';
  $('proof').className = isProven ? 'good' : 'bad';
  const facts = c ? [['energy', format(c.energy)], ['lower bound', format(c.bound)], ['gap', format(Math.max(0, c.energy - c.bound))],
    ['least eigenvalue of W', format(c.eigenvalue)], ['a global minimum is within', format(c.distance)]] : [];
  const reasons = [c && c.reason, shown.covariances && shown.covariances.reason && `No covariance: ${shown.covariances.reason}`].filter(Boolean);
  $('why').textContent = reasons.map((r) => r[0].toUpperCase() + r.slice(1) + '.').join(' ');
  $('facts').replaceChildren(...facts.flatMap(([a, b]) => { const dt = document.createElement('dt'), dd = document.createElement('dd'); dt.textContent = a; dd.textContent = b; return [dt, dd]; }));
  $('take').hidden = !(second && second.energy < shown.energy - 1e-9 * Math.abs(shown.energy));
  if (!second) $('second').textContent = '';
}
function certificateAt(k) { return shown.usable ? solver.certify(iterate(k)) : null; }

// --- The inspector ------------------------------------------------------------------------------------------------

function inspect() {
  const box = $('inspector');
  const field = (label, value, low, high, isLog, set) => {
    const row = document.createElement('label'), range = document.createElement('input'), exact = document.createElement('input'), text = document.createElement('span');
    row.className = 'field'; text.textContent = label;
    range.type = 'range'; exact.type = 'number'; exact.min = 0; exact.step = 'any';
    const place = (v) => isLog ? Math.log10(v) : v;
    range.min = isLog ? Math.log10(low) : low; range.max = isLog ? Math.log10(high) : high; range.step = (range.max - range.min) / 200;
    range.value = value > 0 || !isLog ? place(value) : range.min; exact.value = Number(value.toPrecision(12));
    range.setAttribute('aria-label', label); exact.setAttribute('aria-label', label + ', exact');
    range.onpointerdown = range.onkeydown = () => remember();
    range.oninput = () => { const v = isLog ? 10 ** Number(range.value) : Number(range.value); exact.value = Number(v.toPrecision(5)); set(Number(exact.value)); edited(); };
    exact.onchange = () => { const v = Number(exact.value); if (Number.isFinite(v) && v >= 0) { remember(); set(v); edited(); } };
    row.append(text, range, exact);
    return row;
  };
  const button = (text, act) => { const b = document.createElement('button'); b.textContent = text; b.onclick = act; return b; };
  const row = (...children) => { const d = document.createElement('div'); d.className = 'row'; d.append(...children); return d; };
  const text = (t) => { const p = document.createElement('p'); p.textContent = t; return p; };
  if (!selected) return box.replaceChildren(text('Nothing is selected. Click a part, an anchor or a link.'));
  const i = selected.index;
  if (selected.kind === 'link') {
    const [a, b] = problem.links[i];
    return box.replaceChildren(text(`Link of parts ${a} and ${b}`),
      field('stiffness', problem.link_stiffness[i], reference.link * 1e-4, reference.link * 1e4, true, (v) => { problem.link_stiffness[i] = v; }),
      field('rest length', problem.rest_length[i], 0, 2 * Math.max(reference.size / 2, problem.rest_length[i]), false, (v) => { problem.rest_length[i] = v; }),
      row(button('Cut', removeSelected)));
  }
  const fixed = document.createElement('input'), label = document.createElement('label');
  fixed.type = 'checkbox'; fixed.checked = problem.fixed.includes(i); fixed.onchange = toggleFixed;
  label.append(fixed, ' fixed');
  return box.replaceChildren(text(`${selected.kind === 'anchor' ? 'Anchor of part' : 'Part'} ${i}`),
    field('anchor', problem.anchor_stiffness[i], reference.anchor * 1e-4, reference.anchor * 1e4, true, (v) => { problem.anchor_stiffness[i] = v; }),
    row(label, button('Remove', removeSelected)));
}

// --- Changes ------------------------------------------------------------------------------------------------------

function remember() {
  const now = writeSystem(problem);
  if (past[past.length - 1] !== now) past.push(now);
  if (past.length > 100) past.shift();
  $('undo').disabled = false;
}
function undo() {
  const text = past.pop();
  if (text) {
    const before = problem.dim;
    problem = checkSystem(JSON.parse(text));
    if (problem.dim !== before) show();
    select(selected && selected.kind !== 'link' && selected.index < problem.anchors.length ? selected : {kind: 'node', index: 0});
    edited();
  }
  $('undo').disabled = past.length === 0;
}
/** To be called when the problem has changed. */
function edited() { preset = null; $('preset').value = ''; isStale = true; keepState(); }
/** To be called when its solution has to be computed again. */
function changed() { isStale = true; keepState(); }

function select(what) { selected = what; linkFrom = what && what.kind === 'node' ? linkFrom : -1; inspect(); redo(); landscape = null; }

/** Solves, and shows all from where a view begins. */
function show() {
  solveShown();
  turnTo(...(problem.dim === 3 ? TURN : [0, 0]));
  fit();
}

function take(next, id = null) {
  problem = next; preset = id; second = null; held = null; linkFrom = -1;
  reference.link = median(problem.link_stiffness.filter((k) => k > 0)) || 1;
  reference.anchor = median(problem.anchor_stiffness.filter((k) => k > 0)) || 1;
  selected = {kind: 'node', index: Math.min(2, problem.anchors.length - 1)};
  show(); inspect();
  const known = PRESETS.find((p) => p.id === id);
  $('about').textContent = known ? known.about : problem.name || '';
  $('preset').value = id || '';
  $('view').setAttribute('aria-label', `Constellation: ${problem.name || 'without a name'}, ${problem.anchors.length} parts, ${problem.links.length} links. Comma and full stop select a part, the arrow keys move it.`);
  keepState();
}

function toggleFixed() {
  if (!selected || selected.kind === 'link') return;
  remember();
  const i = selected.index;
  if (problem.fixed.includes(i)) problem.fixed = problem.fixed.filter((j) => j !== i);
  else { problem.fixed.push(i); problem.start[i] = pointOf(shown.x, i); }
  inspect(); edited();
}

function removeLinks(drop) {
  const keep = problem.links.map((_, l) => !drop(l));
  for (const key of ['links', 'rest_length', 'link_stiffness']) problem[key] = problem[key].filter((_, l) => keep[l]);
}
function removeSelected() {
  if (!selected) return;
  const i = selected.index;
  if (selected.kind === 'link') { remember(); removeLinks((l) => l === i); select(null); return edited(); }
  if (problem.anchors.length === 1) { $('status').textContent = 'The last part stays.'; return; }
  remember();
  removeLinks((l) => problem.links[l].includes(i));
  problem.links = problem.links.map((l) => l.map((j) => j > i ? j - 1 : j));
  problem.fixed = problem.fixed.filter((j) => j !== i).map((j) => j > i ? j - 1 : j);
  for (const key of ['anchors', 'anchor_stiffness', 'start']) problem[key].splice(i, 1);
  solver.key = null; shown = null; solveShown();
  select({kind: 'node', index: Math.max(0, i - 1)});
  edited();
}

function addNode(point) {
  if (problem.anchors.length >= MAX_NODES) { $('status').textContent = `${MAX_NODES} parts are the most that this page takes.`; return; }
  remember();
  problem.start = pointsOf(shown.x);
  problem.anchors.push(point); problem.start.push(point.slice()); problem.anchor_stiffness.push(reference.anchor);
  solveShown();
  select({kind: 'node', index: problem.anchors.length - 1});
  edited();
}

/** Draws the link of two parts, at their present distance, or cuts it. */
function toggleLink(a, b) {
  if (a === b || a < 0) return;
  remember();
  const isIt = (l) => problem.links[l].includes(a) && problem.links[l].includes(b);
  if (problem.links.some((_, l) => isIt(l))) removeLinks(isIt);
  else {
    problem.links.push([Math.min(a, b), Math.max(a, b)]);
    problem.rest_length.push(distance(shown.x, a, b));
    problem.link_stiffness.push(reference.link);
  }
  edited();
}

function startAt(points) {
  remember();
  problem.start = points.map((p, i) => problem.fixed.includes(i) ? problem.start[i] : p);
  edited();
}

function moveSelected(dx, dy) {
  if (!selected || selected.kind === 'link') return;
  const i = selected.index;
  remember();
  if (selected.kind === 'node') problem.start = pointsOf(shown.x);
  const points = selected.kind === 'node' ? problem.start : problem.anchors;
  points[i] = points[i].map((v, c) => v + dx * axes[0][c] + dy * axes[1][c]);
  edited();
}

function lookForLower() {
  if (!shown || !shown.usable) return;
  solver.set(problem);
  second = solver.solve(STAIRCASE, shown.x, tolerance());
  const isLower = second.usable && second.energy < shown.energy - 1e-9 * Math.abs(shown.energy);
  $('second').textContent = !second.usable ? `The staircase: ${second.status}: ${second.message}`
    : (isLower ? `The staircase found a minimum of energy ${format(second.energy)}, where this one has ${format(shown.energy)}`
      : 'The staircase found no lower minimum') + (second.bound >= 0 ? `; none is below ${format(second.bound)}.` : '.');
  if (!isLower) second = null;
  const found = second;
  describe();
  if (found) fit(); else $('take').hidden = true;
  isDirty = true;
}

// --- Pointer ------------------------------------------------------------------------------------------------------

let pointer = null;
const fingers = new Map();
const mode = () => document.querySelector('input[name="mode"]:checked').value;
const local = (event) => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };

function hit(sx, sy, reach) {
  const x = position(), n = problem.anchors.length;
  let best = null, least = reach;
  const near = (kind, index, d) => { if (d < least) { least = d; best = {kind, index}; } };
  for (let i = 0; i < n; ++i) { const [px, py] = toScreen(x, i); near('node', i, Math.hypot(px - sx, py - sy)); }
  if ($('show-anchors').checked && mode() === 'move')
    problem.anchors.forEach((a, i) => { if (problem.anchor_stiffness[i] > 0) { const [px, py] = toScreen(a); near('anchor', i, Math.hypot(px - sx, py - sy) + 0.5); } });
  if (best) return best;
  least = reach * 0.6;
  problem.links.forEach(([i, j], l) => {
    const [ax, ay] = toScreen(x, i), [bx, by] = toScreen(x, j);
    const square = (bx - ax) ** 2 + (by - ay) ** 2 || 1, t = Math.max(0, Math.min(1, ((sx - ax) * (bx - ax) + (sy - ay) * (by - ay)) / square));
    near('link', l, Math.hypot(ax + t * (bx - ax) - sx, ay + t * (by - ay) - sy));
  });
  return best;
}

canvas.addEventListener('pointerdown', (event) => {
  if (!shown) return;
  canvas.focus({preventScroll: true});
  canvas.setPointerCapture(event.pointerId);
  const screen = local(event);
  fingers.set(event.pointerId, screen);
  if (fingers.size === 2) { release(); pointer = {kind: 'pinch', from: [...fingers.values()], view: {...view}}; return; }
  const found = hit(...screen, event.pointerType === 'touch' ? 26 : 14);
  stop();
  if (mode() === 'add' && !found) return addNode(toWorld(...screen, centre));
  if (mode() === 'link') {
    if (found && found.kind === 'link') { select(found); return removeSelected(); }
    if (found && found.kind === 'node') { if (linkFrom >= 0 && linkFrom !== found.index) { toggleLink(linkFrom, found.index); linkFrom = -1; return; }
      select(found); linkFrom = found.index; pointer = {kind: 'link', screen}; isDirty = true; return; }
    linkFrom = -1;
  }
  if (!found) { pointer = problem.dim === 3 && !event.shiftKey ? {kind: 'turn', screen, turn} : {kind: 'pan', screen, view: {...view}}; return; }
  select(found);
  const {kind, index} = found;
  if (kind !== 'link') pointer = {kind, index, moved: false, from: screen, near: kind === 'node' ? pointOf(position(), index) : problem.anchors[index]};
});

canvas.addEventListener('pointermove', (event) => {
  if (fingers.has(event.pointerId)) fingers.set(event.pointerId, local(event));
  if (!pointer) return;
  const screen = local(event);
  if (pointer.kind === 'pinch') {
    if (fingers.size < 2) return;
    const [a, b] = fingers.values(), [c, d] = pointer.from, v = pointer.view;
    const ratio = Math.hypot(a[0] - b[0], a[1] - b[1]) / Math.max(1, Math.hypot(c[0] - d[0], c[1] - d[1]));
    view.scale = v.scale * ratio;
    view.x = (c[0] + d[0]) / 2 / v.scale + v.x - (a[0] + b[0]) / 2 / view.scale;
    view.y = (c[1] + d[1]) / 2 / v.scale + v.y - (a[1] + b[1]) / 2 / view.scale;
    return redo();
  }
  if (pointer.kind === 'pan') {
    view.x = pointer.view.x - (screen[0] - pointer.screen[0]) / view.scale;
    view.y = pointer.view.y - (screen[1] - pointer.screen[1]) / view.scale;
    return redo();
  }
  if (pointer.kind === 'turn') {
    turn = pointer.turn;
    return turnBy(screen[0] - pointer.screen[0], screen[1] - pointer.screen[1]);
  }
  if (pointer.kind === 'link') { pointer.screen = screen; isDirty = true; return; }
  if (!pointer.moved && Math.hypot(screen[0] - pointer.from[0], screen[1] - pointer.from[1]) < 3) return;
  if (!pointer.moved) { pointer.moved = true; remember(); }
  const world = toWorld(...screen, pointer.near);
  if (pointer.kind === 'anchor') problem.anchors[pointer.index] = world;
  else {
    if (!held) held = {index: pointer.index, x: Array.from(shown.x)};
    held.at = world;
    holdThere();
  }
  preset = null; $('preset').value = '';
  isStale = true;
});

/** When a part is released, the parts' present positions become the start. */
function release() {
  if (held) { problem.start = pointsOf(Float64Array.from(held.x)); held = null; edited(); }
  else if (pointer && pointer.moved) edited();
  pointer = null;
}
function lift(event) {
  fingers.delete(event.pointerId);
  if (!pointer) return;
  if (pointer.kind === 'link' && event.type === 'pointerup') {
    const found = hit(...local(event), event.pointerType === 'touch' ? 26 : 14);
    if (found && found.kind === 'node' && found.index !== linkFrom) { toggleLink(linkFrom, found.index); linkFrom = -1; }
    isDirty = true;
  }
  if (pointer.kind === 'pinch' && fingers.size) return;
  release();
}
canvas.addEventListener('pointerup', lift);
canvas.addEventListener('pointercancel', lift);
canvas.addEventListener('wheel', (event) => {
  event.preventDefault();
  const [sx, sy] = local(event), wx = sx / view.scale + view.x, wy = sy / view.scale + view.y;
  view.scale *= Math.exp(-event.deltaY * 0.0015);
  view.x = wx - sx / view.scale; view.y = wy - sy / view.scale;
  redo();
}, {passive: false});

// --- Keys ---------------------------------------------------------------------------------------------------------

canvas.addEventListener('keydown', (event) => {
  if (!shown || event.altKey) return;
  const key = event.key, n = problem.anchors.length;
  if (event.ctrlKey || event.metaKey) { if (key === 'z') { event.preventDefault(); undo(); } return; }
  const far = (event.shiftKey ? 40 : 5) / view.scale;
  const scale = (factor) => {
    if (!selected) return;
    remember();
    const list = selected.kind === 'link' ? problem.link_stiffness : problem.anchor_stiffness;
    list[selected.index] *= factor;
    inspect(); edited();
  };
  const next = (by) => select({kind: 'node', index: ((selected && selected.kind !== 'link' ? selected.index : 0) + by + n) % n});
  const acts = {
    ',': () => next(-1), '.': () => next(1),
    'a': () => selected && selected.kind !== 'link' && select({kind: selected.kind === 'node' ? 'anchor' : 'node', index: selected.index}),
    'ArrowLeft': () => moveSelected(-far, 0), 'ArrowRight': () => moveSelected(far, 0),
    'ArrowUp': () => moveSelected(0, -far), 'ArrowDown': () => moveSelected(0, far),
    'l': () => { if (selected && selected.kind === 'node') { linkFrom = selected.index; $('status').textContent = `Link from part ${linkFrom}: select another one and press Enter.`; } },
    'Enter': () => { if (linkFrom >= 0 && selected && selected.kind === 'node') { toggleLink(linkFrom, selected.index); linkFrom = -1; } },
    'Escape': () => { linkFrom = -1; isDirty = true; },
    '4': () => turnBy(-10, 0), '6': () => turnBy(10, 0), '8': () => turnBy(0, -10), '2': () => turnBy(0, 10),
    '+': () => scale(1.5), '=': () => scale(1.5), '-': () => scale(1 / 1.5), 'x': toggleFixed,
    'Delete': removeSelected, 'Backspace': removeSelected,
    ' ': play, 'r': randomStart, 'f': fit,
  };
  const act = acts[key.length === 1 ? key.toLowerCase() : key];
  if (!act) return;
  event.preventDefault();
  act();
  if (selected && [',', '.', 'a'].includes(key.toLowerCase()) && linkFrom < 0)
    $('status').textContent = `${selected.kind === 'anchor' ? 'Anchor of part' : 'Part'} ${selected.index} of ${n} is selected.`;
  isDirty = true;
});

// --- Playing ------------------------------------------------------------------------------------------------------

function stop() { playing = 0; $('play').textContent = 'Play'; }
function play() {
  if (playing) return stop();
  if (shown.energies.length < 2) return;
  at = 0; playing = performance.now(); $('play').textContent = 'Pause'; isDirty = true;
}
function randomStart() {
  const box = boxOf([...problem.anchors, ...pointsOf(shown.x)]);
  startAt(problem.anchors.map(() => box.map(([low, high]) => low + Math.random() * (high - low))));
}

function frame(now) {
  requestAnimationFrame(frame);
  if (!problem) return;
  const begin = performance.now(), isSolved = isStale;
  if (isStale) { isStale = false; solveShown(); isDirty = true; }
  if (playing) {
    const last = shown.energies.length - 1, seconds = Math.min(4, 0.4 + last / 12);
    const k = Math.floor((now - playing) / 1000 / seconds * (last + 1));
    if (k >= last) { at = Infinity; stop(); } else at = Math.max(0, k);
    isDirty = true;
  }
  if (!pointer || pointer.kind === 'pan' || pointer.kind === 'pinch' || !pointer.moved) {
    if (tasks.length && !held) solver.set(problem);
    while (tasks.length && performance.now() - begin < FRAME) tasks.shift()();
  } else if (tasks[0] === mapLandscape) tasks.shift()();
  if (!isDirty) return;
  isDirty = false;
  draw(); drawCharts(); describe();
  if (isSolved && times.push(performance.now() - begin) > 600) times.shift();
}

// --- State in the link --------------------------------------------------------------------------------------------

const SHOWS = ['path', 'ellipses', 'landscape', 'anchors'];
async function pipe(bytes, transform) { return new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(transform)).arrayBuffer()); }
async function pack(text) {
  const bytes = await pipe(new TextEncoder().encode(text), new CompressionStream('deflate'));
  let binary = '';
  for (const b of bytes) binary += String.fromCharCode(b);
  return btoa(binary).replace(/\+/g, '-').replace(/\//g, '_').replace(/=+$/, '');
}
async function unpack(text) {
  const binary = atob(text.replace(/-/g, '+').replace(/_/g, '/'));
  return new TextDecoder().decode(await pipe(Uint8Array.from(binary, (c) => c.charCodeAt(0)), new DecompressionStream('deflate')));
}
async function hash() {
  const fields = [preset ? `preset=${preset}` : `system=${await pack(writeSystem(problem))}`, `method=${METHODS[method()][0]}`, `tolerance=${$('tolerance').value}`,
    `show=${SHOWS.filter((s) => $('show-' + s).checked).join('+')}`, ...(problem.dim === 3 ? [`turn=${turn.map((v) => v.toFixed(3))}`] : [])];
  return '#' + fields.join('&');
}
let keeping = 0;
function keepState() {
  clearTimeout(keeping);
  keeping = setTimeout(async () => { const h = await hash(); if (h !== location.hash) history.replaceState(null, '', h); }, 250);
}
/** Takes the state from the link. Returns whether the link holds a system; without one, the problem stays. */
async function readState() {
  const fields = Object.fromEntries(location.hash.slice(1).split('&').map((f) => f.split(/=(.*)/s).slice(0, 2)));
  const index = METHODS.findIndex(([id]) => id === fields.method);
  if (index >= 0) $('method').selectedIndex = index;
  if ([...$('tolerance').options].some((o) => o.value === fields.tolerance)) $('tolerance').value = fields.tolerance;
  if (fields.show !== undefined) SHOWS.forEach((s) => { $('show-' + s).checked = fields.show.split('+').includes(s); });
  const known = PRESETS.find((p) => p.id === fields.preset);
  if (fields.system) take(readSystem(await unpack(fields.system)));
  else if (known) take(checkSystem(known.make()), known.id);
  else return false;
  const angles = (fields.turn || '').split(',').map(Number);
  if (problem.dim === 3 && angles.length === 2 && angles.every(Number.isFinite)) turnTo(...angles);
  return true;
}

/** Repaints everything that depends on the theme. */
function repaint() { colors = {}; landscape = null; redo(); }

// --- Beginning ----------------------------------------------------------------------------------------------------

function begin() {
  for (const {id, title} of PRESETS) $('preset').add(new Option(title, id));
  const own = new Option('Your own', ''); own.hidden = true; $('preset').add(own);
  for (const [id, title] of METHODS) $('method').add(new Option(title, id));
  $('method').value = 'newton';
  $('preset').onchange = () => { const p = PRESETS.find((q) => q.id === $('preset').value); if (p) { past.length = 0; $('undo').disabled = true; take(checkSystem(p.make()), p.id); } };
  $('method').onchange = $('tolerance').onchange = changed;
  for (const s of SHOWS) $('show-' + s).onchange = () => { if (s === 'ellipses') isStale = true; redo(); keepState(); };
  for (const m of document.getElementsByName('mode')) m.onchange = () => { linkFrom = -1; isDirty = true; };
  $('undo').onclick = undo; $('undo').disabled = true;
  $('fit').onclick = fit; $('play').onclick = play;
  $('from-anchors').onclick = () => startAt(copy(problem.anchors));
  $('from-random').onclick = randomStart;
  $('scrub').oninput = () => { stop(); const k = Number($('scrub').value); at = k >= shown.energies.length - 1 ? Infinity : k; redo(); };
  $('staircase').onclick = lookForLower;
  $('take').onclick = () => { if (second) startAt(pointsOf(second.x)); };
  for (const [id, factor] of [['weaker', 0.1], ['stiffer', 10]])
    $(id).onclick = () => { remember(); problem.anchor_stiffness = problem.anchor_stiffness.map((k) => k * factor); inspect(); edited(); };
  $('save').onclick = () => {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(new Blob([writeSystem(problem) + '\n'], {type: 'application/json'}));
    link.download = `${(problem.name || 'system').replace(/[^\w-]+/g, '-')}.json`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  };
  const open = async (file) => {
    try { const next = readSystem(await file.text()); if (problem) remember(); take(next); } catch (error) { $('status').textContent = `${file.name}: ${error.message}`; }
  };
  $('load').onclick = () => $('file').click();
  $('file').onchange = () => { if ($('file').files[0]) open($('file').files[0]); $('file').value = ''; };
  addEventListener('dragover', (event) => event.preventDefault());
  addEventListener('drop', (event) => { event.preventDefault(); if (event.dataTransfer.files[0]) open(event.dataTransfer.files[0]); });
  $('link').onclick = async () => {
    history.replaceState(null, '', await hash());
    try { await navigator.clipboard.writeText(location.href); $('status').textContent = 'The link is copied.'; } catch { $('status').textContent = 'The link is in the address bar.'; }
  };
  addEventListener('hashchange', () => readState().catch(complain));
  new ResizeObserver(resized).observe(canvas);
  startTheme($('theme'), repaint);
}
function complain(error) { $('status').textContent = `The link: ${error.message}`; }

begin();
if (typeof createPlayground === 'undefined') {
  document.body.classList.add('unbuilt');
  $('about').textContent = 'The playground is not built here: its solver, solver.js, is compiled by emscripten, as docs/playground.md says.';
} else {
  createPlayground().then(async (module) => {
    solver = new Solver(module);
    let has = false;
    try { has = await readState(); } catch (error) { take(checkSystem(PRESETS[0].make()), PRESETS[0].id); complain(error); has = true; }
    if (!has) take(checkSystem(PRESETS[0].make()), PRESETS[0].id);
    requestAnimationFrame(frame);
    // For the tests, and for use in the console.
    window.playground = {
      system: () => writeSystem(problem),
      result: () => ({x: Array.from(shown.x), status: shown.status, energy: shown.energy, iterations: shown.iterations, proof: shown.certificate && shown.certificate.proof,
        bound: shown.certificate && shown.certificate.bound}),
      methods: () => all.map((s) => s && {status: s.status, energy: s.energy, iterations: s.iterations}),
      isIdle: () => !isStale && !isDirty && tasks.length === 0 && !held,
      place: (kind, i) => { const [sx, sy] = kind === 'anchor' ? toScreen(problem.anchors[i]) : toScreen(shown.x, i), box = canvas.getBoundingClientRect(); return [box.left + sx, box.top + sy]; },
      read: (text) => take(readSystem(text)),
      second: () => second && {energy: second.energy, bound: second.bound},
      times: () => times.splice(0),
      hash,
    };
  }).catch((error) => { $('status').textContent = `The solver did not start: ${error.message}`; });
}
})();
