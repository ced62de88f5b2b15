// Newton's iterations and derivatives of solutions for four nodes with AVX-512: a vector holds all eight
// coordinates, or all six links. A solve waits for a chain of operations that depend on each other. It is
// shorter here than in NewtonMatrix, because the elimination runs over the rows above the pivots, too
// (Gauss-Jordan), and no substitution follows.
#define ASTERISM_LANES_AVX512

#include <asterism/solver/energy/four_nodes.hpp>

#include "batch_lanes.hpp"

namespace asterism::lanes_v0_1 {
namespace {

using L = DoubleLanes;
using V = L::V;
using Mask = __mmask8;

constexpr double kEpsilon = 0x1p-52;
constexpr double kLeastSquare = 0x1p-970;   // as in spring_element.hpp
constexpr double kRounding = 8 * kEpsilon;  // of pivots, and of alignment
constexpr double kInfinity = __builtin_huge_val();
constexpr int kTerms = 10;  // of the energy: four anchors, six links

ASTERISM_INLINE V pick(V a, __m512i at) { return _mm512_permutexvar_pd(at, a); }
ASTERISM_INLINE V pick(V a, int lane) { return pick(a, _mm512_set1_epi64(lane)); }
ASTERISM_INLINE __m512i indices(int a, int b, int c, int d, int e, int f, int g, int h) {
  return _mm512_setr_epi64(a, b, c, d, e, f, g, h);
}
ASTERISM_INLINE V of_nodes(const double* values) {  // each twice, for x and y
  const V four = _mm512_castpd256_pd512(_mm256_loadu_pd(values));
  return pick(four, indices(0, 0, 1, 1, 2, 2, 3, 3));
}
ASTERISM_INLINE V of_links(const double* values) { return _mm512_maskz_loadu_pd(0x3F, values); }
// Of values of links, x and y, those of one link for each node.
ASTERISM_INLINE V to_nodes(V x, V y, int a, int b, int c, int d) {
  return _mm512_permutex2var_pd(x, indices(a, a + 8, b, b + 8, c, c + 8, d, d + 8), y);
}
ASTERISM_INLINE V swap_xy(V a) { return _mm512_permute_pd(a, 0x55); }
ASTERISM_INLINE V minus_plus() { return _mm512_setr_pd(-1, 1, -1, 1, -1, 1, -1, 1); }
// Over the nodes, x and y apart.
ASTERISM_INLINE V sum_of_nodes(V a) {
  a = a + _mm512_shuffle_f64x2(a, a, 0x4E);
  return a + _mm512_shuffle_f64x2(a, a, 0xB1);
}
ASTERISM_INLINE V sum_all(V a) {
  a = sum_of_nodes(a);
  return a + swap_xy(a);
}
ASTERISM_INLINE double dot(V a, V b) { return sum_all(a * b)[0]; }

struct System {
  V anchors, anchor_stiffness, link_stiffness, rest_length;
  V push;       // k mu
  V stiffness;  // A_ii
  V rounding;   // of the pivots
  V weights;    // of the stopping rule
  double tolerance;
  // For alignment.
  bool realigns = false;
  double total;
  V centre, offsets;  // of the anchors; from it, times the stiffness
  double spread;
};

ASTERISM_INLINE System load(const FourNodes& from) {
  System s;
  s.anchors = L::load(from.anchors);
  s.anchor_stiffness = of_nodes(from.anchor_stiffness);
  s.link_stiffness = of_links(from.link_stiffness);
  s.rest_length = of_links(from.rest_length);
  s.push = s.link_stiffness * s.rest_length;
  s.stiffness = of_nodes(from.node_stiffness);
  s.rounding = s.stiffness * L::set(kRounding);
  s.weights = L::inverse(s.stiffness * L::set(from.length));
  s.tolerance = from.tolerance;
  return s;
}

ASTERISM_INLINE void prepare_alignment(System& s) {
  s.realigns = true;
  const V total = sum_of_nodes(s.anchor_stiffness);
  s.total = total[0];
  s.centre = sum_of_nodes(s.anchor_stiffness * s.anchors) * L::inverse(total);
  const V offsets = s.anchors - s.centre;
  s.offsets = s.anchor_stiffness * offsets;
  s.spread = dot(s.offsets, offsets);
}

// What the kernels serve.
ASTERISM_INLINE bool is_served(const FourNodes& nodes, const System& s) {
  return nodes.length > 0 && (L::bits(L::less(L::set(0), s.link_stiffness)) & 0x3FU) == 0x3F;
}

// As detail::align.
ASTERISM_INLINE V aligned(const System& s, V x) {
  if (!(s.total > 0 && s.total < kInfinity)) return x;
  const V centre = sum_of_nodes(s.anchor_stiffness * x) * L::inverse(L::set(s.total));
  const V p = x - centre;
  // sum_i k_i (cos, sin) of the angle that turns p_i to the anchor's offset.
  const V cosine = sum_all(s.offsets * p), sine = sum_all(s.offsets * swap_xy(p) * minus_plus());
  const double spread = dot(s.anchor_stiffness * p, p);
  const V shift = centre - s.centre;
  const double rounding =
      kRounding * kRounding * s.total * (dot(centre, centre) + dot(s.centre, s.centre)) / 4;
  const V square = L::fma(cosine, cosine, sine * sine);
  V c = L::set(1), turned = L::set(0);
  double gain = s.total * dot(shift, shift) / 4;
  if (square[0] >= kLeastSquare && spread > rounding && s.spread > rounding) [[likely]] {
    const V inverse = L::inverse_sqrt(square);
    c = cosine * inverse;
    turned = sine * inverse * minus_plus();
    gain += 2 * (square[0] * inverse[0] - cosine[0]);
  }
  if (!(gain > kRounding * (spread + s.spread) + rounding)) return x;
  return L::fma(c, p, L::fma(turned, swap_xy(p), s.centre));
}

struct Value {
  V gradient;
  double energy;
};

// The links' ends apart. In the last two lanes, the first link stands once more, without stiffness.
ASTERISM_INLINE V along_x(V a) {
  return pick(a, indices(0, 0, 0, 2, 2, 4, 0, 0)) - pick(a, indices(2, 4, 6, 4, 6, 6, 2, 2));
}
ASTERISM_INLINE V along_y(V a) {
  return pick(a, indices(1, 1, 1, 3, 3, 5, 1, 1)) - pick(a, indices(3, 5, 7, 5, 7, 7, 3, 3));
}

// A node's three links, on the diagonal of H.
ASTERISM_INLINE V on_diagonal(V anchors, V x, V y) {
  return (anchors + to_nodes(x, y, 0, 0, 1, 2)) + (to_nodes(x, y, 1, 3, 3, 4) + to_nodes(x, y, 2, 4, 5, 5));
}
// A column of H: those of `node` on the diagonal, elsewhere minus the link to each node.
template <unsigned kNode>
ASTERISM_INLINE V column(V diagonal, V x, V y, int a, int b, int c, int d) {
  constexpr auto kOthers = static_cast<Mask>(~(3U << 2 * kNode));
  return _mm512_mask_sub_pd(diagonal, kOthers, L::set(0), to_nodes(x, y, a, b, c, d));
}

// Energy, gradient and the columns of H, or of its clamped form. False where two nodes coincide.
ASTERISM_INLINE bool evaluate(const System& s, V x, bool clamp, Value& value, V* columns) {
  const V dx = along_x(x), dy = along_y(x);
  const V square = L::fma(dx, dx, dy * dy);
  if (L::bits(L::at_most(L::set(kLeastSquare), square)) != 0xFF) [[unlikely]]
    return false;
  const V inverse = L::inverse_sqrt(square);
  const V stretch = L::fma(square, inverse, -s.rest_length);
  const V tension = s.link_stiffness * stretch;
  const V pull = tension * inverse;
  const V pull_x = pull * dx, pull_y = pull * dy;
  const V offset = x - s.anchors;
  const V force = s.anchor_stiffness * offset;
  value.energy = sum_all(L::fma(force, offset, tension * stretch))[0] / 2;
  V g = L::fma(to_nodes(pull_x, pull_y, 0, 0, 1, 2), _mm512_setr_pd(1, 1, -1, -1, -1, -1, -1, -1), force);
  g = L::fma(to_nodes(pull_x, pull_y, 1, 3, 3, 4), _mm512_setr_pd(1, 1, 1, 1, -1, -1, -1, -1), g);
  value.gradient = L::fma(to_nodes(pull_x, pull_y, 2, 4, 5, 5), _mm512_setr_pd(1, 1, 1, 1, 1, 1, -1, -1), g);

  // Along a link k, across it k (1 - mu / r), the difference k mu / r; clamped by values, as a branch would
  // be mispredicted.
  const V push = s.push * inverse;
  const V across = L::max(s.link_stiffness - push, L::set(clamp ? 0 : -kInfinity));
  const V difference = L::min(push, clamp ? s.link_stiffness : L::set(kInfinity));
  const V bend = difference * (inverse * inverse);
  const V xx = L::fma(dx * dx, bend, across), xy = dx * dy * bend, yy = L::fma(dy * dy, bend, across);
  const V on_x = on_diagonal(_mm512_maskz_mov_pd(0x55, s.anchor_stiffness), xx, xy);
  const V on_y = on_diagonal(_mm512_maskz_mov_pd(0xAA, s.anchor_stiffness), xy, yy);
  columns[0] = column<0>(on_x, xx, xy, 0, 0, 1, 2);
  columns[1] = column<0>(on_y, xy, yy, 0, 0, 1, 2);
  columns[2] = column<1>(on_x, xx, xy, 0, 0, 3, 4);
  columns[3] = column<1>(on_y, xy, yy, 0, 0, 3, 4);
  columns[4] = column<2>(on_x, xx, xy, 1, 3, 0, 5);
  columns[5] = column<2>(on_y, xy, yy, 1, 3, 0, 5);
  columns[6] = column<3>(on_x, xx, xy, 2, 4, 5, 0);
  columns[7] = column<3>(on_y, xy, yy, 2, 4, 5, 0);
  return true;
}

struct Pivots {
  double first[4], determinant[4];  // of each node's pair
  bool definite;
};

// NewtonMatrix::repair.
double repaired(double pivot, double rounding, bool& definite) {
  if (pivot > rounding) return pivot;
  definite = false;
  return pivot < -rounding ? -pivot : rounding / kRounding;
}

// Eliminates the pair of a node from all other rows of the columns behind it and of the right-hand side; its
// own rows become those of the inverse.
template <int kNode>
ASTERISM_INLINE void eliminate(const System& s, V* columns, V& right_side, Pivots& pivots) {
  constexpr int k = 2 * kNode;
  constexpr auto kPair = static_cast<Mask>(3U << k);
  constexpr auto kOthers = static_cast<Mask>(~kPair);
  // Scalars, as processors divide whole vectors in twice the time.
  double p = pick(columns[k], k)[0], q = pick(columns[k + 1], k + 1)[0];
  const double b = pick(columns[k], k + 1)[0];
  double determinant = __builtin_fma(-b, b, p * q);
  const double rounding = pick(s.rounding, k)[0];
  if (!(p > rounding && determinant > rounding * p && determinant > 0x1p-900 && determinant < 0x1p900))
      [[unlikely]] {
    p = repaired(p, rounding, pivots.definite);
    q = repaired(q - b / p * b, rounding, pivots.definite);
    determinant = p * q;
  }
  pivots.first[kNode] = p;
  pivots.determinant[kNode] = determinant;
  const V inverse_p = L::set(1 / p), ratio = L::set(b / p), inverse_second = L::set(p / determinant);
  // In the pair's own rows, minus the unit matrix stands for the columns, and 0 for the others' values.
  const V first =
      _mm512_mask_mov_pd(columns[k], kPair, _mm512_mask_sub_pd(L::set(0), 1U << k, L::set(0), L::set(1)));
  const V second =
      _mm512_mask_mov_pd(columns[k + 1], kPair, _mm512_mask_sub_pd(L::set(0), 2U << k, L::set(0), L::set(1)));
  // Not by the pair's inverse matrix, whose rounding grows as the determinant falls.
  const V rest = L::fnma(ratio, first, second);
  const auto update = [&](V& a) ASTERISM_INLINED {
    const V at_first = pick(a, k), at_second = L::fnma(ratio, at_first, pick(a, k + 1));
    a = L::fnma(first, at_first * inverse_p, _mm512_maskz_mov_pd(kOthers, a));
    a = L::fnma(rest * at_second, inverse_second, a);
  };
  for (int c = k + 2; c < 8; ++c) update(columns[c]);
  update(right_side);
}

// H^-1 g, with pivots repaired; the columns are used up.
ASTERISM_INLINE V solve(const System& s, V* columns, V gradient, Pivots& pivots) {
  pivots.definite = true;
  eliminate<0>(s, columns, gradient, pivots);
  eliminate<1>(s, columns, gradient, pivots);
  eliminate<2>(s, columns, gradient, pivots);
  eliminate<3>(s, columns, gradient, pivots);
  return gradient;
}

// StoppingRule::reached.
ASTERISM_INLINE bool is_stationary(const System& s, V gradient) {
  const V scaled = gradient * s.weights, square = scaled * scaled;
  return L::bits(L::less(L::set(s.tolerance * s.tolerance), square + swap_xy(square))) == 0;
}

ASTERISM_INLINE double rounding_of(double energy) { return kTerms * kEpsilon * energy; }

// Whether Newton::may_turn_indefinite.
bool may_turn_indefinite(const FourNodes& at, const Pivots& pivots, double square, V x) {
  double least = kInfinity;
  for (int i = 0; i < 4; ++i) {
    const double first = pivots.first[i], second = pivots.determinant[i] / first;
    const double pivot = (first < second ? first : second) / at.node_stiffness[i];
    least = pivot < least ? pivot : least;
  }
  const V offsets = x - sum_of_nodes(x) * L::set(0.25);
  const double spread = dot(offsets, offsets) / 4, length_square = at.length * at.length, flat = 1e-3 * least;
  return square > flat * flat * (spread < length_square ? spread : length_square);
}

// Newton::search.
ASTERISM_INLINE bool search(FourNodesSearch& at, const System& s, V direction, double decrement, bool clamp,
                            V& x, Value& here, V* columns) {
  if (!(decrement > 0)) return false;
  const double rounding = rounding_of(here.energy);
  double t = 1;
  for (int trial = 0; trial < 12; ++trial) {
    V next_x = L::fnma(L::set(t), direction, x);
    if (s.realigns) next_x = aligned(s, next_x);
    Value next;
    ++at.evaluations;
    if (!evaluate(s, next_x, clamp, next, columns)) return false;
    bool falls = next.energy <= here.energy - 1e-4 * t * decrement && next.energy < here.energy;
    if (!falls && decrement <= 8 * rounding && next.energy <= here.energy + rounding)
      falls = dot(next.gradient, next.gradient) < dot(here.gradient, here.gradient) / 4;
    if (falls) {
      x = next_x;
      here = next;
      return true;
    }
    const double vertex = t * t * decrement / (2 * (next.energy - here.energy + t * decrement));
    t = !(vertex > t / 10) ? t / 10 : vertex < t / 2 ? vertex : t / 2;
  }
  return false;
}

// Newton::finish.
ASTERISM_INLINE bool finish(FourNodesSearch& at, const System& s, V direction, Pivots& pivots, V& x,
                            Value& here, V* columns) {
  V next_x = x - direction;
  if (s.realigns) next_x = aligned(s, next_x);
  Value next;
  ++at.evaluations;
  if (!evaluate(s, next_x, false, next, columns)) return false;
  if (!(next.energy <= here.energy + rounding_of(here.energy) && is_stationary(s, next.gradient)))
    return false;
  const V moved = next_x - x;
  if (may_turn_indefinite(at.nodes, pivots, dot(moved, moved), x)) {
    ++at.factorizations;
    solve(s, columns, next.gradient, pivots);
  }
  x = next_x;
  here = next;
  ++at.iterations;
  return true;
}

// Newton::iterate. Where it ends early, Newton begins with the same matrix at the same x.
ASTERISM_INLINE void iterate(FourNodesSearch& at, const System& s, V& x, Value& here, V* columns) {
  while (true) {
    const bool stationary = is_stationary(s, here.gradient);
    if (!stationary && at.iterations == at.max_iterations) return;
    if (stationary && at.clamps) {
      at.clamps = false;
      ++at.evaluations;
      evaluate(s, x, false, here, columns);
    }
    Pivots pivots;
    ++at.factorizations;
    const V direction = solve(s, columns, here.gradient, pivots);
    const double decrement = dot(here.gradient, direction);
    const bool small = decrement <= 2 * s.tolerance * here.energy;
    if (stationary && !(pivots.definite && small)) return;
    if (stationary ||
        (pivots.definite && small && !at.clamps && finish(at, s, direction, pivots, x, here, columns))) {
      at.converged = true;
      at.definite = pivots.definite;
      return;
    }
    const bool clamps = decrement > here.energy && at.iterations + 1 < 4;
    if (!search(at, s, direction, decrement, clamps, x, here, columns)) return;
    at.clamps = clamps;
    ++at.iterations;
  }
}

// hold_of_body of free_motion.hpp, less what is rounding beside the links' stiffness.
ASTERISM_INLINE bool is_held(const System& s, V x) {
  const V inverse = L::inverse(sum_of_nodes(s.anchor_stiffness));
  const V q = s.anchors - sum_of_nodes(s.anchor_stiffness * s.anchors) * inverse;
  const V p = x - sum_of_nodes(s.anchor_stiffness * x) * inverse;
  const V margin = s.anchor_stiffness * L::fma(p, p, q * q) * L::set(0.5e-4) +
                   s.stiffness * (p * p) * L::set(512 * kEpsilon);
  return sum_all(L::fma(s.anchor_stiffness * p, q, -margin))[0] > 0;
}

// Whether all pivots are above 64 times their rounding, whatever the order of sums.
ASTERISM_INLINE bool is_clear(const FourNodes& at, const Pivots& pivots) {
  bool clear = pivots.definite;
  for (int i = 0; i < 4; ++i) {
    const double least = 64 * kRounding * at.node_stiffness[i];
    clear = clear && pivots.first[i] > least && pivots.determinant[i] > least * pivots.first[i];
  }
  return clear;
}

// Whether the links are long enough to have a direction, see ImplicitSolver.
ASTERISM_INLINE bool has_directions(const FourNodes& at, V x, V square) {
  const V squares = x * x, of_node = squares + swap_xy(squares);
  const V extent = L::fma(L::set(2), of_node, L::set(at.length * at.length));
  const V least = L::max(extent * L::set(8 * kRounding * kRounding), L::set(8 * kLeastSquare));
  return _mm512_reduce_min_pd(square) > _mm512_reduce_max_pd(least);
}

}  // namespace

bool iterate_four_nodes_avx512(FourNodesSearch& at);
bool iterate_four_nodes_avx512(FourNodesSearch& at) {
  System system = load(at.nodes);
  if (!is_served(at.nodes, system)) return false;
  if (at.realigns) prepare_alignment(system);
  V x = L::load(at.x), columns[8];
  Value here;
  at.evaluations = 1;
  if (!evaluate(system, x, at.clamps, here, columns)) return false;
  const double first = here.energy;
  iterate(at, system, x, here, columns);
  // The portable code rounds energies in another way: where so little is gained, it has to decide.
  constexpr double kClear = 1e-9;
  if (!(here.energy < (1 - kClear) * first)) return false;
  L::store(at.x, x);
  return true;
}

bool differentiate_four_nodes_avx512(const FourNodes& at, const FourNodesGradient& gradient);
bool differentiate_four_nodes_avx512(const FourNodes& at, const FourNodesGradient& gradient) {
  System system = load(at);
  system.tolerance /= 2;  // passed whatever the rounding of the gradient
  if (!is_served(at, system)) return false;
  const V x = L::load(gradient.x);
  V columns[8];
  Value value;
  if (!evaluate(system, x, false, value, columns)) return false;
  Pivots pivots;
  const V lambda = solve(system, columns, L::load(gradient.by_x), pivots);

  // dL/d(values) = -lambda^T dg/d(values), as Sensitivity::differentiate.
  const V by_anchors = system.anchor_stiffness * lambda;
  const V work = lambda * (system.anchors - x), by_anchor_stiffness = work + swap_xy(work);
  const V dx = along_x(x), dy = along_y(x), square = L::fma(dx, dx, dy * dy);
  const V inverse = L::inverse_sqrt(square);
  const V apart = L::fma(dx, along_x(lambda), dy * along_y(lambda)) * inverse;  // how fast it moves the ends
  const V by_rest_length = system.link_stiffness * apart;
  const V by_link_stiffness = L::fnms(square, inverse, -system.rest_length) * apart;

  const V sizes = by_anchors * by_anchors + by_anchor_stiffness * by_anchor_stiffness +
                  by_rest_length * by_rest_length + by_link_stiffness * by_link_stiffness;
  if (!(has_directions(at, x, square) && is_stationary(system, value.gradient) && is_clear(at, pivots) &&
        is_held(system, x) && sum_all(sizes)[0] < kInfinity))
    return false;
  L::store(gradient.by_anchors, by_anchors);
  _mm256_storeu_pd(gradient.by_anchor_stiffness,
                   _mm512_castpd512_pd256(pick(by_anchor_stiffness, indices(0, 2, 4, 6, 0, 0, 0, 0))));
  _mm512_mask_storeu_pd(gradient.by_rest_length, 0x3F, by_rest_length);
  _mm512_mask_storeu_pd(gradient.by_link_stiffness, 0x3F, by_link_stiffness);
  return true;
}

}  // namespace asterism::lanes_v0_1
