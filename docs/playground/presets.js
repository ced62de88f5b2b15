'use strict';
/* The playground's systems: each `make` returns one in the form of docs/system-json.md. Stiffness is 1 / (standard deviation)^2. */
const PRESETS = (() => {
  const system = (name, anchors, k, links, mu, kl, more = {}) => ({
    asterism_system: 1, name, dim: anchors[0].length, anchors, anchor_stiffness: [k].flat().length === 1 ? anchors.map(() => [k].flat()[0]) : k,
    links, rest_length: mu === undefined ? links.map(([i, j]) => distance(anchors[i], anchors[j])) : [mu].flat().length === 1 ? links.map(() => [mu].flat()[0]) : mu,
    link_stiffness: [kl].flat().length === 1 ? links.map(() => [kl].flat()[0]) : kl, ...more,
  });
  const distance = (a, b) => Math.hypot(...a.map((v, c) => v - b[c]));
  const pairs = (n) => Array.from({length: n}, (_, i) => Array.from({length: n - i - 1}, (_, j) => [i, i + j + 1])).flat();
  const ring = (n, r, turn = 0) => Array.from({length: n}, (_, i) => [r * Math.cos(2 * Math.PI * i / n + turn), r * Math.sin(2 * Math.PI * i / n + turn)]);
  // Pseudo-random numbers in [-1, 1), the same on every machine.
  const noise = (seed) => () => { seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0; return seed / 2147483648 - 1; };

  const parts = () => {
    const anchors = [[0, 0], [62, -8], [-6, 70], [74, 64], [30, 130]];
    const shape = [[0, 0], [60, 0], [0, 62], [60, 62], [30, 118]];
    return system('five parts', anchors, [0.02, 0.01, 0.03, 0.002, 0.01], pairs(5), pairs(5).map(([i, j]) => distance(shape[i], shape[j])), 0.02);
  };
  const twoMinima = () => system('two minima', [[0, 0], [100, 0], [50, 20]], [1e-2, 1e-2, 5e-4], pairs(3), 100, 1e-2, {start: [[0, 0], [100, 0], [50, -20]]});
  const oneAnchor = () => system('two parts, one anchor', [[0, 0], [0, 0], [90, 10]], [0.01, 0.01, 0.02], [[0, 1], [1, 2]], [80, 40], [0.02, 0.02], {start: [[-3, 20], [4, -30], [70, 40]]});
  const nearCoincident = () => system('near-coincident parts (Figure 8)',
    [[0.04033496863101371, 0.689142669407231], [0.8737487053964023, 0.4906610188379199], [-0.17482430326181259, 0.27397045038807555], [0.33430210240032376, 0.7376352267005859]],
    [595.8756431467882, 499.703651696046, 596.4126248915841, 1416.2782451979324], pairs(4),
    [1e-2, 0.2998377696953763, 0.41175436624562783, 0.2998377696953763, 0.41175436624562783, 0.1231809541801978],
    [1e6, 1112.313792540211, 589.8255396785228, 1112.313792540211, 589.8255396785228, 6590.416656330925],
    {start: [[0.15277278824284224, 0.5423113238766478], [0.6267541729890651, 0.32609522944719505], [-0.272475992309567, 0.03246396446563793], [0.39292901107067024, 0.5767480922606549]]});
  const hardCase = () => ({...nearCoincident(), name: 'hard case (Figure 8)',
    rest_length: [1e-6, ...nearCoincident().rest_length.slice(1)], link_stiffness: [1e14, ...nearCoincident().link_stiffness.slice(1)]});
  const weakAnchors = () => {
    const n = 8, random = noise(5), anchors = ring(n, 60).map(([x, y]) => [x + 14 * random(), y + 14 * random()]);
    return system('weak anchors', anchors, 1e-4, pairs(n), pairs(n).map(([i, j]) => 120 * Math.abs(Math.sin(Math.PI * (i - j) / n))), 0.01,
      {start: ring(n, 60, 0.9).map(([x, y]) => [x + 30, y + 20 * random()])});
  };
  const tracked = () => system('tracked: a pedestrian, frame 61',
    [[200.98838137811413, 129.5156949530215], [215.38002523814936, 128.90223979485893], [202.6155498721569, 175.52352445600138], [218.05290058655228, 178.4654189807311]],
    [0.0009233670676709095, 0.0014112810893420575, 0.0008253316702529912, 0.0006733485357867465], pairs(4),
    [15.154869516775884, 49.09654208047405, 53.32929670297174, 51.10997188802708, 51.858373346416926, 12.06979059668537],
    [0.0024501914981254714, 0.003884419286871905, 0.0007810201536884747, 0.002943376398910486, 0.0018378463924570475, 0.09121910154924365],
    {start: [[200.7849994622001, 129.96096689704822], [215.94238587412914, 129.3010532337862], [203.84289992664188, 178.95694191222543], [215.712663561687, 181.15221151161728]],
      origin: {tracker: 'dpt', sequence: 'woman', frame: 61}});
  const cable = () => {
    const n = 25, anchors = Array.from({length: n}, (_, i) => [10 * i, 400]);
    const start = anchors.map(([x], i) => [x, i % 2 ? 12 : -12]);
    start[0] = [0, 0]; start[n - 1] = [240, 30];
    return system('cable', anchors, 2e-5, anchors.slice(1).map((_, i) => [i, i + 1]), 12.5, 0.05, {fixed: [0, n - 1], start});
  };
  const cloth = () => {
    const n = 10, at = (r, c) => n * r + c, anchors = [], links = [], mu = [], kl = [];
    for (let r = 0; r < n; ++r) for (let c = 0; c < n; ++c) anchors.push([20 * c, 20 * r]);
    const link = (a, b, k) => { links.push([a, b]); mu.push(distance(anchors[a], anchors[b])); kl.push(k); };
    for (let r = 0; r < n; ++r) for (let c = 0; c < n; ++c) {
      if (c + 1 < n) link(at(r, c), at(r, c + 1), 0.05);
      if (r + 1 < n) link(at(r, c), at(r + 1, c), 0.05);
      if (r + 1 < n && c + 1 < n) { link(at(r, c), at(r + 1, c + 1), 0.01); link(at(r, c + 1), at(r + 1, c), 0.01); }
    }
    const start = anchors.map((p) => p.slice());
    start[0] = [-25, -15]; start[n - 1] = [205, -25];
    return system('cloth of 100 parts', anchors, 1e-3, links, mu, kl, {fixed: [0, n - 1], start});
  };
  // Links all pairs, with lengths by their distances in the graph, as for a layout by stress majorisation.
  const layout = (name, edges, anchors, k, seed) => {
    const n = anchors.length;
    const apart = Array.from({length: n}, (_, i) => Array.from({length: n}, (_, j) => i === j ? 0 : Infinity));
    for (const [i, j] of edges) apart[i][j] = apart[j][i] = 1;
    for (let k = 0; k < n; ++k) for (let i = 0; i < n; ++i) for (let j = 0; j < n; ++j) apart[i][j] = Math.min(apart[i][j], apart[i][k] + apart[k][j]);
    const random = noise(seed), all = pairs(n);
    return system(name, anchors, k, all, all.map(([i, j]) => 50 * apart[i][j]), all.map(([i, j]) => 0.01 / apart[i][j] ** 2),
      {start: anchors.map((a) => a.map(() => 90 * random()))});
  };
  // As the generalised Petersen graph G(10, 2).
  const dodecahedron = Array.from({length: 10}, (_, i) => [[i, (i + 1) % 10], [i, i + 10], [i + 10, (i + 2) % 10 + 10]]).flat();
  const graph = () => layout('graph: the dodecahedron', dodecahedron, ring(20, 80), 1e-3, 7);
  const solid = () => layout('the dodecahedron in space', dodecahedron, ring(20, 80).map(([x, y], i) => [x, 8 * i - 76, y]), 1e-3, 1);
  const box = () => {
    const random = noise(3), shape = Array.from({length: 8}, (_, i) => [i & 1 ? 90 : 0, i & 2 ? 60 : 0, i & 4 ? 50 : 0]);
    const links = pairs(8).filter(([i, j]) => [1, 2, 4, 7].includes(i ^ j));  // edges, and diagonals through the middle
    const anchors = shape.map((p) => p.map((v) => v + 8 * random()));
    anchors[6] = [60, -30, 110];
    return system('a box in space', anchors, shape.map((_, i) => i === 6 ? 5e-4 : 0.01), links, links.map(([i, j]) => distance(shape[i], shape[j])), 0.02);
  };
  const contradiction = () => {
    const anchors = ring(6, 55);
    return system('contradictory lengths', anchors, 1e-3, pairs(6), pairs(6).map(([i, j]) => [90, 40, 120][(i + 2 * j) % 3]), 0.01);
  };
  const truss = () => {
    const n = 7, anchors = [], links = [];
    for (let i = 0; i < n; ++i) anchors.push([40 * i, 0], [40 * i + 20, -35]);
    for (let i = 0; i + 1 < 2 * n; ++i) { links.push([i, i + 1]); if (i + 2 < 2 * n) links.push([i, i + 2]); }
    const mu = links.map(([i, j]) => distance(anchors[i], anchors[j]));
    return system('bridge', anchors.map(([x, y], i) => i === 0 || i === 12 ? [x, y] : [x, y + 60]), 5e-4, links, mu, 0.05, {fixed: [0, 12], start: anchors});
  };

  return [
    ['parts', 'Five parts', 'Springs keep five parts near the places where they were found, their anchors (squares). Drag a part or an anchor.', parts],
    ['two-minima', 'Two minima', 'The third part started above the line of the others; the lower minimum is below it, where its anchor is.', twoMinima],
    ['one-anchor', 'Two parts on one anchor', 'The first two parts could lie in any direction from their anchor; the third part decides.', oneAnchor],
    ['near-coincident', 'Near-coincident parts', 'As in Figure 8 of the paper: the first two parts should be 0.01 apart, while the others are about 0.5 apart.', nearCoincident],
    ['hard-case', 'The hard case of Figure 8', 'The same with a distance of 1e-6 and a spring of stiffness 1e14: methods end at different energies.', hardCase],
    ['weak-anchors', 'Weak anchors', 'The shape is found at once; turning it to its anchors takes many iterations.', weakAnchors],
    ['tracked', 'A tracked pedestrian', 'Four parts as the DPT tracker recorded them in frame 61 of the sequence woman.', tracked],
    ['cable', 'A cable', 'A chain between two fixed parts; weak anchors far below act like weights.', cable],
    ['cloth', 'A cloth', '100 parts, 342 links, two corners fixed.', cloth],
    ['graph', 'A graph', 'A dodecahedron drawn by stress majorisation: all pairs are linked, with the weight 1 / distance². Methods end in different minima.', graph],
    ['contradiction', 'Contradictory lengths', 'No placement has all these lengths: nothing is certified, and the bound stays below the energy.', contradiction],
    ['bridge', 'A bridge', 'A truss on two supports with weights on its other joints.', truss],
    ['box', 'A box in space', 'Eight parts in space, one of which was seen far off, with little certainty. Drag an empty place to turn the view, and a part to move it in the plane of the screen.', box],
    ['solid', 'A graph in space', 'The same dodecahedron by the same stress majorisation, in space, where its distances fit better. Drag an empty place to turn the view.', solid],
  ].map(([id, title, about, make]) => ({id, title, about, make}));
})();
