// Layouts of JavaScript for layouts.py: node layouts.js METHOD < {"nodes": N, "edges": [[i, j, length], ...]} > [[x, y], ...]
// METHOD is d3-force, webcola (packages that `require` has to find), or sgd: stochastic gradient descent by Zheng, Pawar and
// Goodman (2018), written from the paper, with the schedule that its authors' s_gd2 has by default.
"use strict";

function d3Force(n, edges) {
  const d3 = require("d3-force");
  const nodes = Array.from({ length: n }, () => ({}));
  const links = edges.map(([source, target, length]) => ({ source, target, length }));
  const link = d3.forceLink(links).distance((each) => 30 * each.length);
  d3.forceSimulation(nodes).force("link", link).force("charge", d3.forceManyBody()).stop().tick(300);
  return nodes;
}

function webcola(n, edges) {
  const cola = require("webcola");
  const nodes = Array.from({ length: n }, () => ({}));
  const links = edges.map(([source, target, length]) => ({ source, target, length }));
  new cola.Layout().nodes(nodes).links(links).linkDistance((each) => 30 * each.length).handleDisconnected(false).start();
  return nodes;
}

/** Lengths of shortest paths from `source`: Dijkstra's algorithm, with a binary heap of [length, node]. */
function pathsFrom(source, neighbours, lengths) {
  lengths.fill(Infinity);
  lengths[source] = 0;
  const heap = [[0, source]];
  while (heap.length) {
    const [length, node] = heap[0];
    const last = heap.pop();
    if (heap.length) {
      let k = 0;
      for (let child; (child = 2 * k + 1) < heap.length; k = child) {
        if (child + 1 < heap.length && heap[child + 1][0] < heap[child][0]) ++child;
        if (heap[child][0] >= last[0]) break;
        heap[k] = heap[child];
      }
      heap[k] = last;
    }
    if (length > lengths[node]) continue;
    for (const [next, step] of neighbours[node]) {
      if (length + step >= lengths[next]) continue;
      lengths[next] = length + step;
      let k = heap.push(null) - 1;
      for (; k > 0 && heap[(k - 1) >> 1][0] > lengths[next]; k = (k - 1) >> 1) heap[k] = heap[(k - 1) >> 1];
      heap[k] = [lengths[next], next];
    }
  }
}

function sgd(n, edges) {
  const iterations = 30, epsilon = 0.01;
  let state = 1; // xorshift
  const random = () => {
    state ^= state << 13;
    state ^= state >>> 17;
    state ^= state << 5;
    return (state >>> 0) / 4294967296;
  };
  const neighbours = Array.from({ length: n }, () => []);
  for (const [i, j, length] of edges) neighbours[i].push([j, length]), neighbours[j].push([i, length]);
  const count = (n * (n - 1)) / 2;
  const from = new Int32Array(count), to = new Int32Array(count), d = new Float64Array(count);
  const lengths = new Float64Array(n);
  for (let i = 0, e = 0; i < n; ++i) {
    pathsFrom(i, neighbours, lengths);
    for (let j = i + 1; j < n; ++j, ++e) from[e] = i, to[e] = j, d[e] = lengths[j];
  }
  const x = Float64Array.from({ length: 2 * n }, random);
  const order = Int32Array.from({ length: count }, (_, e) => e);
  const first = d.reduce((a, b) => Math.max(a, b)) ** 2, last = epsilon * d.reduce((a, b) => Math.min(a, b)) ** 2;
  for (let t = 0; t < iterations; ++t) {
    const step = first * (last / first) ** (t / (iterations - 1));
    for (let k = count - 1; k > 0; --k) {
      const other = Math.floor(random() * (k + 1)), e = order[k];
      order[k] = order[other];
      order[other] = e;
    }
    for (const e of order) {
      const i = 2 * from[e], j = 2 * to[e], dx = x[i] - x[j], dy = x[i + 1] - x[j + 1];
      const length = Math.sqrt(dx * dx + dy * dy) || 1;
      const move = (Math.min(step / (d[e] * d[e]), 1) * (length - d[e])) / (2 * length);
      x[i] -= move * dx, x[i + 1] -= move * dy;
      x[j] += move * dx, x[j + 1] += move * dy;
    }
  }
  return Array.from({ length: n }, (_, k) => ({ x: x[2 * k], y: x[2 * k + 1] }));
}

const { nodes, edges } = JSON.parse(require("fs").readFileSync(0, "utf8"));
const drawn = { "d3-force": d3Force, webcola, sgd }[process.argv[2]](nodes, edges);
process.stdout.write(JSON.stringify(drawn.map(({ x, y }) => [x, y])));
