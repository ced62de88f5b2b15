'use strict';
/* The results of four trackers on a clip. RECORDING (trackers-data.js) and PEDESTRIAN (pedestrian-data.js) are written by record.py:
 * clip.background and clip.frames[t] = [x, y, image of the part that differs from it]; trackers[k].frames[t] = {box, angle,
 * confidence, lost, overlap, threshold, size, parts: [[x, y, x where it looks best, y, weight, updated]], links}. Links are left
 * out if they are those of the frame before. The first frame, in which the box is given, has only a box. A clip without
 * annotation has no clip.boxes, and its frames no overlap. */
(() => {
const $ = (id) => document.getElementById(id);
// `opening`: the frame on which the clip opens; the object begins to pass behind the post, so that parts and springs are seen.
const CLIPS = [
  {name: 'drawn', title: 'a drawn object', opening: 46, ...RECORDING},
  {name: 'pedestrian', title: 'a pedestrian', opening: 28, ...PEDESTRIAN},
];
const X = 0, Y = 1, BEST_X = 2, BEST_Y = 3, WEIGHT = 4, UPDATED = 5;
const SHOWS = ['parts', 'springs', 'best', 'true'];
const HUES = [210, 275, 325, 25, 55, 150];  // of parts
const LEFT = 26, RIGHT = 8, TOP = 6, BOTTOM = 18;  // margins of a chart [px]
const TRUE_BOX = '#ffffff', BOX = '#ffe14d', DARK = 'rgba(0, 0, 0, .65)';

for (const tracker of CLIPS.flatMap((c) => c.trackers)) {
  let links = [];
  for (const frame of tracker.frames) { links = frame.links || links; frame.links = links; frame.parts = frame.parts || []; }
  const counts = new Set(tracker.frames.slice(1).map((f) => f.parts.length));
  tracker.parts = Math.max(...counts);
  tracker.areSame = counts.size === 1;  // the parts of all frames: each has a curve
  tracker.isGated = tracker.frames.some((f) => f.threshold > 0);
}

let clip = CLIPS[0], CLIP = clip.clip, TRACKERS = clip.trackers, COUNT = CLIP.frames.length;
let tracker = TRACKERS[0], at = clip.opening, selected = -1, isPlaying = false, began = 0, isDirty = true, stateTimer = 0;
const answer = () => tracker.frames[at];

// --- Images -------------------------------------------------------------------------------------------------------

function picture(source) {
  const image = new Image();
  image.src = source;
  return {image, ready: image.decode()};
}
for (const c of CLIPS) {
  c.background = picture(c.clip.background);
  c.patches = c.clip.frames.map(([x, y, source]) => ({x, y, ...picture(source)}));
}
const loaded = Promise.all(CLIPS.flatMap((c) => [c.background, ...c.patches]).map((p) => p.ready));

// --- Drawing ------------------------------------------------------------------------------------------------------

let colors = {};
function color(name) {
  return colors[name] = colors[name] || getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim();
}
/** Parts with a curve have colors of their own. On the frame they are those of the dark theme, which stand out there. */
function partColor(i, onFrame) {
  const isBright = onFrame || document.documentElement.dataset.theme === 'dark';
  return `hsl(${HUES[i % HUES.length]} 85% ${isBright ? 68 : 40}%)`;
}
function context(canvas) {
  const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const g = canvas.getContext('2d');
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, width, height);
  return [g, width, height];
}
const isSelected = (i) => tracker.areSame && i === selected;
const isFaded = (part) => tracker.isGated && !part[UPDATED];
/** Of a part on the frame: faded if it did not learn or, if parts never learn, by its weight. */
const opacity = (part) => tracker.isGated ? (part[UPDATED] ? 1 : 0.6) : 0.2 + 0.8 * Math.min(1, part[WEIGHT]);

/** Canvas pixels per pixel of the clip, and the clip's corner. */
function placed() {
  const width = $('view').clientWidth, height = $('view').clientHeight, scale = Math.min(width / CLIP.width, height / CLIP.height);
  return [scale, (width - scale * CLIP.width) / 2, (height - scale * CLIP.height) / 2];
}

function drawFrame() {
  const [g] = context($('view')), [scale, left, top] = placed();
  // Pixels' edges are the coordinates; positions of parts are pixel centres.
  g.translate(left, top);
  g.scale(scale, scale);
  g.beginPath(); g.rect(0, 0, CLIP.width, CLIP.height); g.clip();
  if (clip.background.image.complete) g.drawImage(clip.background.image, 0, 0);
  const patch = clip.patches[at];
  if (patch.image.complete) g.drawImage(patch.image, patch.x, patch.y);
  g.translate(0.5, 0.5);
  const px = 1 / scale;
  const stroke = (width, style, dash) => {  // with a dark rim, so that it is seen on any ground
    g.setLineDash((dash || []).map((d) => d * px)); g.lineWidth = (width + 2) * px; g.strokeStyle = DARK; g.stroke();
    g.lineWidth = width * px; g.strokeStyle = style; g.stroke(); g.setLineDash([]);
  };
  const box = ([x, y, width, height], style, dash) => { g.beginPath(); g.rect(x - 0.5, y - 0.5, width, height); stroke(2, style, dash); };
  const frame = answer(), many = frame.parts.length > 12;
  if ($('show-true').checked && CLIP.boxes) box(CLIP.boxes[at], TRUE_BOX, [6, 5]);
  box(frame.box, BOX);
  if ($('show-springs').checked) {
    for (const [i, j] of frame.links) {
      const a = frame.parts[i], b = frame.parts[j];
      g.globalAlpha = many ? 0.55 : 0.85;
      g.beginPath(); g.moveTo(a[X], a[Y]); g.lineTo(b[X], b[Y]);
      g.lineWidth = (many ? 1 : 1.5) * px; g.strokeStyle = '#ffffff'; g.stroke();
    }
    g.globalAlpha = 1;
  }
  frame.parts.forEach((part, i) => {
    const style = tracker.areSame ? partColor(i, true) : '#7cc4ff';
    if ($('show-best').checked) {
      g.globalAlpha = opacity(part);
      g.beginPath(); g.moveTo(part[X], part[Y]); g.lineTo(part[BEST_X], part[BEST_Y]); stroke(1, style);
      const d = 4 * px;
      g.beginPath(); g.moveTo(part[BEST_X] - d, part[BEST_Y] - d); g.lineTo(part[BEST_X] + d, part[BEST_Y] + d);
      g.moveTo(part[BEST_X] - d, part[BEST_Y] + d); g.lineTo(part[BEST_X] + d, part[BEST_Y] - d); stroke(1.5, style);
    }
    if ($('show-parts').checked) {
      g.globalAlpha = opacity(part);
      if (!many) {
        g.save(); g.translate(part[X], part[Y]); g.rotate(frame.angle);
        g.beginPath(); g.rect(-frame.size[0] / 2, -frame.size[1] / 2, frame.size[0], frame.size[1]);
        if (isSelected(i)) { g.fillStyle = style; g.globalAlpha *= 0.3; g.fill(); g.globalAlpha = opacity(part); }
        g.restore();
        stroke(isSelected(i) ? 3 : 1.5, style, isFaded(part) ? [4, 4] : []);
      }
      g.beginPath(); g.arc(part[X], part[Y], (many ? 4 : 5) * px, 0, 7);
      g.fillStyle = style; g.fill(); g.lineWidth = 1.5 * px; g.strokeStyle = DARK; g.stroke();
    }
    g.globalAlpha = 1;
  });
}

/** A chart over the frames: axes, the shares that are hidden and shaded, and what `draw` adds; then the frame's marker. */
function chart(canvas, highest, draw) {
  const [g, width, height] = context(canvas);
  const x = (t) => LEFT + (width - LEFT - RIGHT) * t / (COUNT - 1), y = (v) => TOP + (height - TOP - BOTTOM) * (1 - v / highest);
  const area = (shares, style, alpha) => {
    g.beginPath(); g.moveTo(x(0), y(0));
    shares.forEach((v, t) => g.lineTo(x(t), y(v * highest)));
    g.lineTo(x(COUNT - 1), y(0)); g.fillStyle = style; g.globalAlpha = alpha; g.fill(); g.globalAlpha = 1;
  };
  area(CLIP.shaded, color('shaded'), 0.22);
  area(CLIP.hidden, color('hidden'), 0.45);
  g.font = '11px system-ui, sans-serif'; g.fillStyle = color('soft'); g.strokeStyle = color('line'); g.lineWidth = 1;
  g.textAlign = 'right'; g.textBaseline = 'middle';
  for (const v of [0, 0.5, 1]) if (v <= highest) {
    g.beginPath(); g.moveTo(LEFT, y(v)); g.lineTo(width - RIGHT, y(v)); g.stroke(); g.fillText(String(v), LEFT - 5, y(v));
  }
  g.textAlign = 'center'; g.textBaseline = 'alphabetic';
  for (let t = 0; t < COUNT; t += 20) g.fillText(String(t), x(t), height - 4);
  const line = (values, style, lineWidth, dash) => {  // null: a gap
    g.beginPath();
    let isOpen = false;
    values.forEach((v, t) => {
      if (v === null) { isOpen = false; return; }
      if (isOpen) g.lineTo(x(t), y(v)); else g.moveTo(x(t), y(v));
      isOpen = true;
    });
    g.strokeStyle = style; g.lineWidth = lineWidth; g.setLineDash(dash || []); g.lineJoin = 'round'; g.stroke(); g.setLineDash([]);
  };
  draw(g, x, y, line);
  g.beginPath(); g.moveTo(x(at), TOP); g.lineTo(x(at), height - BOTTOM); g.strokeStyle = color('text'); g.lineWidth = 1.5; g.stroke();
}

function drawWeights() {
  if (tracker.parts === 0) return;
  chart($('weights'), 1, (g, x, y, line) => {
    const dot = (t, v, radius) => { g.beginPath(); g.arc(x(t), y(v), radius, 0, 7); g.fill(); };
    if (!tracker.areSame) {  // parts come and go: a dot for each
      tracker.frames.forEach((frame, t) => {
        g.fillStyle = t === at ? color('overlap') : color('soft'); g.globalAlpha = t === at ? 1 : 0.3;
        for (const part of frame.parts) dot(t, part[WEIGHT], t === at ? 3 : 1.3);
      });
      g.globalAlpha = 1;
      line(tracker.frames.map((f) => f.parts.length ? f.parts.map((p) => p[WEIGHT]).sort((a, b) => a - b)[f.parts.length >> 1] : null), color('overlap'), 2);
      return;
    }
    for (let i = 0; i < tracker.parts; ++i) {
      const weights = tracker.frames.map((f) => f.parts.length ? f.parts[i][WEIGHT] : null);
      // Solid where it learned: each step belongs to the frame at its end.
      g.globalAlpha = selected < 0 || isSelected(i) ? 0.75 : 0.2;
      line(weights, partColor(i), 1, [2, 2]);
      g.globalAlpha = selected < 0 || isSelected(i) ? 1 : 0.25;
      for (let t = 2; t < COUNT; ++t) if (tracker.frames[t].parts[i][UPDATED]) {
        g.beginPath(); g.moveTo(x(t - 1), y(weights[t - 1])); g.lineTo(x(t), y(weights[t]));
        g.strokeStyle = partColor(i); g.lineWidth = isSelected(i) ? 3 : 1.7; g.stroke();
      }
      if (weights[at] !== null) { g.fillStyle = partColor(i); dot(at, weights[at], isSelected(i) ? 5 : 3.5); }
      g.globalAlpha = 1;
    }
    line(tracker.frames.map((f) => f.parts.length ? f.threshold : null), color('text'), 1.5, [6, 4]);
  });
}

function drawQuality() {
  chart($('quality'), 1, (g, x, y, line) => {
    for (const other of TRACKERS) if (other !== tracker) {
      g.globalAlpha = 0.35;
      line(other.frames.map((f) => f.overlap === undefined ? null : f.overlap), color('overlap'), 1);
    }
    g.globalAlpha = 1;
    const of = (key) => tracker.frames.map((f) => f[key] === undefined ? null : f[key]);
    line(of('confidence'), color('confidence'), 1.7, [5, 3]);
    line(of('overlap'), color('overlap'), 2.2);
    g.fillStyle = color('overlap');
    if (at > 0 && CLIP.boxes) { g.beginPath(); g.arc(x(at), y(answer().overlap), 4, 0, 7); g.fill(); }
  });
}

// --- Text ---------------------------------------------------------------------------------------------------------

const fixed = (v, digits = 2) => v === undefined ? '–' : v.toFixed(digits);
const mean = (values) => values.reduce((a, b) => a + b, 0) / values.length;

function row(cells, onclick) {
  const tr = document.createElement('tr');
  for (const cell of cells) { const td = document.createElement('td'); td.append(cell); tr.append(td); }
  if (onclick) tr.onclick = onclick;
  return tr;
}

function writeStatus() {
  const frame = answer();
  $('at').textContent = `${at} / ${COUNT - 1}`;
  $('scrub').value = at;
  const parts = [];
  if (at === 0) parts.push('The start: the box is given, and the parts are learned in it.');
  else {
    parts.push(`${CLIP.boxes ? `Overlap with the true box ${fixed(frame.overlap)}, confidence` : 'Confidence'} ${fixed(frame.confidence)}${frame.lost ? '; the tracker reports the object as lost' : ''}.`);
    if (tracker.isGated) {
      const still = frame.parts.flatMap((p, i) => p[UPDATED] ? [] : [i + 1]);
      parts.push(still.length === 0 ? 'All parts learn.' : still.length === frame.parts.length ? 'No part learns.' : `Not learning: ${still.length > 1 ? 'parts' : 'part'} ${still.join(', ')}.`);
    } else if (frame.parts.length) parts.push(`${frame.parts.length} parts.`);
  }
  $('status').textContent = parts.join(' ');
  $('play').textContent = isPlaying ? 'Pause' : 'Play';
}

function writeParts() {
  $('parts').tBodies[0].replaceChildren(...answer().parts.map((part, i) => {
    const name = document.createElement('span'), swatch = document.createElement('span');
    swatch.className = 'swatch'; swatch.style.background = tracker.areSame ? partColor(i) : color('overlap');
    name.append(swatch, ` ${i + 1}`);
    const tr = row(tracker.isGated ? [name, fixed(part[WEIGHT], 3), part[UPDATED] ? 'yes' : 'no'] : [name, fixed(part[WEIGHT], 3)],
                   tracker.areSame ? () => select(i === selected ? -1 : i) : null);
    tr.classList.toggle('chosen', isSelected(i));
    tr.classList.toggle('faded', isFaded(part));
    return tr;
  }));
}

function writeOverlaps() {
  if (!CLIP.boxes) return;
  $('overlaps').tBodies[0].replaceChildren(...TRACKERS.map((t) => {
    const overlaps = t.frames.slice(1).map((f) => f.overlap);
    const tr = row([t.name, fixed(t.frames[at].overlap), fixed(mean(overlaps)), fixed(Math.min(...overlaps))], () => choose(t));
    tr.classList.toggle('chosen', t === tracker);
    return tr;
  }));
}

function writeTracker() {
  $('tracker').value = tracker.name;
  $('about').textContent = `${tracker.name}: ${tracker.about}.`;
  $('weights-panel').hidden = tracker.parts === 0;
  $('parts-scroll').hidden = tracker.parts === 0;
  $('learned-head').hidden = !tracker.isGated;
  $('weights-key').textContent = tracker.isGated
    ? 'How much the part looks like what it has learned. Parts below the threshold (the dashed line) do not learn: their curves are dotted, and on the frame they are faded.'
    : 'How similar the image is to the part’s histogram, which never changes. The parts change: each dot is one, the line is their median.';
  for (const s of ['parts', 'springs', 'best']) $('show-' + s).disabled = tracker.parts === 0;
}

function writeClip() {
  $('clip').value = clip.name;
  $('scrub').max = COUNT - 1;
  $('show-true').disabled = $('overlaps').hidden = !CLIP.boxes;
  $('quality-title').textContent = CLIP.boxes ? 'Confidence and overlap' : 'Confidence';
  for (const e of document.querySelectorAll('.of-truth')) e.hidden = !CLIP.boxes;
  for (const e of document.querySelectorAll('.of-shadow')) e.hidden = !CLIP.shaded.some((v) => v > 0);
}

// --- State --------------------------------------------------------------------------------------------------------

function redraw() { if (!isDirty) { isDirty = true; requestAnimationFrame(draw); } }
function draw() {
  isDirty = false;
  drawFrame(); drawWeights(); drawQuality(); writeStatus(); writeParts(); writeOverlaps();
}
function go(frame) {
  at = Math.max(0, Math.min(COUNT - 1, Math.round(frame)));
  redraw(); keepState();
}
function show(next) {
  if (next === clip) return;
  pause();
  clip = next; CLIP = clip.clip; TRACKERS = clip.trackers; COUNT = CLIP.frames.length;
  at = clip.opening; selected = -1;
  tracker = TRACKERS.find((t) => t.name === tracker.name);
  writeClip(); writeTracker(); redraw(); keepState();
}
function choose(next) { if (!next.areSame || next.parts !== tracker.parts) selected = -1; tracker = next; writeTracker(); redraw(); keepState(); }
function select(part) { if (tracker.areSame && tracker.parts > 0) { selected = part; redraw(); keepState(); } }
function pause() { isPlaying = false; redraw(); keepState(); }
function play() {
  if (isPlaying) { pause(); return; }
  if (at === COUNT - 1) at = 0;
  isPlaying = true;
  restart();
  requestAnimationFrame(step);
  redraw();
}
function restart() { began = performance.now() - 1000 * at / Number($('rate').value); }
function step(now) {
  if (!isPlaying) return;
  const next = Math.max(at, Math.min(COUNT - 1, Math.floor((now - began) * Number($('rate').value) / 1000)));
  if (next !== at) { at = next; redraw(); }
  if (at === COUNT - 1) pause(); else requestAnimationFrame(step);
}

/** The address holds the state; it is written when the visitor rests, as browsers limit how often. */
function keepState() {
  clearTimeout(stateTimer);
  if (isPlaying) return;
  stateTimer = setTimeout(() => {
    const shows = SHOWS.filter((s) => $('show-' + s).checked).join('+');
    history.replaceState(null, '', `#${clip === CLIPS[0] ? '' : `clip=${clip.name}&`}tracker=${tracker.name}&frame=${at}${selected >= 0 ? `&part=${selected + 1}` : ''}&show=${shows}`);
  }, 300);
}
function readState() {
  const fields = Object.fromEntries(location.hash.slice(1).split('&').map((f) => f.split('=')));
  show(CLIPS.find((c) => c.name === fields.clip) || CLIPS[0]);
  tracker = TRACKERS.find((t) => t.name === fields.tracker) || tracker;
  const frame = Number(fields.frame), part = Number(fields.part);
  if (Number.isInteger(frame) && frame >= 0 && frame < COUNT) at = frame;
  selected = tracker.areSame && Number.isInteger(part) && part >= 1 && part <= tracker.parts ? part - 1 : -1;
  if (fields.show !== undefined) for (const s of SHOWS) $('show-' + s).checked = fields.show.split('+').includes(s);
  writeTracker(); redraw();
}

/** Repaints everything that depends on the theme. */
function repaint() { colors = {}; redraw(); }

// --- Beginning ----------------------------------------------------------------------------------------------------

function keyDown(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const target = event.target, isSlider = target.type === 'range', key = event.key;
  if (target.tagName === 'SELECT') return;
  const far = event.shiftKey ? 10 : 1;
  const isIn = (...names) => names.includes(target.tagName);
  let action;
  if (key === 'ArrowLeft') action = () => { pause(); go(at - far); };
  else if (key === 'ArrowRight') action = () => { pause(); go(at + far); };
  else if (key === 'Home') action = () => { pause(); go(0); };
  else if (key === 'End') action = () => { pause(); go(COUNT - 1); };
  else if (key === ' ' && (isSlider || !isIn('BUTTON', 'INPUT', 'A', 'SUMMARY'))) action = play;
  else if (key === ',' || key === '.') action = () => {
    if (tracker.parts > 0) select(((selected < 0 && key === ',' ? 0 : selected) + (key === '.' ? 1 : -1) + tracker.parts) % tracker.parts);
  };
  else if (key === 'Escape') action = () => select(-1);
  else if (TRACKERS[Number(key) - 1]) action = () => choose(TRACKERS[Number(key) - 1]);
  if (action) { event.preventDefault(); action(); }
}

/** The part of the frame under the pointer, the nearest one, or -1. */
function partUnder(event) {
  const [scale, left, top] = placed(), rect = $('view').getBoundingClientRect(), frame = answer();
  const x = (event.clientX - rect.left - left) / scale - 0.5, y = (event.clientY - rect.top - top) / scale - 0.5;
  let best = -1, distance = Infinity;
  frame.parts.forEach((part, i) => {
    const d = Math.hypot(part[X] - x, part[Y] - y);
    if (d < distance && d < Math.max(...frame.size) / 2) { best = i; distance = d; }
  });
  return best;
}

function scrubOn(canvas) {
  const move = (event) => {
    const rect = canvas.getBoundingClientRect();
    go((COUNT - 1) * (event.clientX - rect.left - LEFT) / (rect.width - LEFT - RIGHT));
  };
  canvas.onpointerdown = (event) => { canvas.setPointerCapture(event.pointerId); pause(); move(event); };
  canvas.onpointermove = (event) => { if (canvas.hasPointerCapture(event.pointerId)) move(event); };
}

function begin() {
  for (const {name, title} of CLIPS) $('clip').add(new Option(title, name));
  for (const {name} of TRACKERS) $('tracker').add(new Option(name, name));
  writeClip();
  $('clip').onchange = () => show(CLIPS[$('clip').selectedIndex]);
  $('tracker').onchange = () => choose(TRACKERS[$('tracker').selectedIndex]);
  $('scrub').oninput = () => { pause(); go(Number($('scrub').value)); };
  $('play').onclick = play;
  $('rate').onchange = restart;
  for (const s of SHOWS) $('show-' + s).onchange = () => { redraw(); keepState(); };
  $('view').onclick = (event) => { const part = partUnder(event); select(part === selected ? -1 : part); };
  scrubOn($('weights')); scrubOn($('quality'));
  document.addEventListener('keydown', keyDown);
  addEventListener('hashchange', readState);
  const observer = new ResizeObserver(redraw);
  for (const id of ['view', 'weights', 'quality']) observer.observe($(id));
  isDirty = false;
  startTheme($('theme'), repaint); readState();
}

begin();
loaded.then(() => {
  redraw();
  // For the tests, and for use in the console.
  window.viewer = {
    isIdle: () => !isDirty && !isPlaying,
    state: () => ({clip: clip.name, tracker: tracker.name, frame: at, selected, parts: answer().parts.length, rows: $('parts').tBodies[0].rows.length}),
  };
}, (error) => { $('status').textContent = `The images of the clip: ${error.message}`; });
})();
