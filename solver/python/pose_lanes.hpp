#pragma once

// The kernels of asterism.pose for the vectors of one instruction set, ASTERISM_POSE_LANES numbers wide.
#include <asterism/solver/linear/difference_chain.hpp>

#include "pose_kernel.hpp"

namespace asterism::pose_kernels {
namespace {

typedef double Lanes __attribute__((vector_size(8 * ASTERISM_POSE_LANES)));

/// Degrees of freedom of Student's t distribution of detections in the plane, and of changes of velocity:
/// animals rest, and start suddenly.
constexpr double kDetection = 4, kMotion = 1;
/// Sudden motions come in bursts: neighbours on each side that share the variance of a change of velocity.
constexpr std::ptrdiff_t kBurst = 2;
constexpr double kTwoPi = 6.283185307179586;

inline Lanes* lanes(double* p) { return reinterpret_cast<Lanes*>(p); }
inline const Lanes* lanes(const double* p) { return reinterpret_cast<const Lanes*>(p); }
inline Lanes greater(Lanes a, Lanes b) { return a > b ? a : b; }
inline Lanes less(Lanes a, double b) { return a < b ? a : Lanes{} + b; }

/// The error [px] of a joint if it is at x, without the view's offset, and its derivative.
template <int Dim>
struct Residual {
  Lanes rows[2][Dim], error[2];

  Residual(const JointGroup& g, std::ptrdiff_t frame, std::ptrdiff_t view, const Lanes* x, bool along_ray) {
    const Lanes* seen = lanes(g.sights) + (frame * g.views + view) * 6;
    if constexpr (Dim == 2) {
      for (int r = 0; r < 2; ++r) {
        for (int c = 0; c < 2; ++c) rows[r][c] = Lanes{} + (r == c ? 1.0 : 0.0);
        error[r] = x[r] - seen[r];
      }
    } else {
      const double* camera = g.cameras + view * 12;
      Lanes at[3], image[2], across[2][3];
      for (int r = 0; r < 3; ++r)
        at[r] = camera[r * 3] * x[0] + camera[r * 3 + 1] * x[1] + camera[r * 3 + 2] * x[2] + camera[9 + r];
      const Lanes nearness = 1.0 / greater(at[2], Lanes{} + g.least_depth[view]);
      for (int r = 0; r < 2; ++r) {
        image[r] = at[r] * nearness;
        for (int c = 0; c < 3; ++c)
          across[r][c] = (camera[r * 3 + c] - (along_ray ? seen[r] : image[r]) * camera[6 + c]) * nearness;
      }
      const Lanes off[2] = {image[0] - seen[0], image[1] - seen[1]};
      for (int r = 0; r < 2; ++r) {
        error[r] = seen[2 + r * 2] * off[0] + seen[3 + r * 2] * off[1];
        for (int c = 0; c < 3; ++c)
          rows[r][c] = seen[2 + r * 2] * across[0][c] + seen[3 + r * 2] * across[1][c];
      }
    }
  }

  /// The variance of the error, in both coordinates together, if x has this covariance (E).
  Lanes blur(const Lanes* covariance) const {
    using Chain = lanes_v0_1::DifferenceChain<Dim, Lanes>;
    Lanes sum{};
    for (int r = 0; r < 2; ++r) {
      if constexpr (Dim == 2) {
        sum += covariance[Chain::entry(r, r)];
      } else {
        for (int a = 0; a < Dim; ++a) {
          Lanes along{};
          for (int b = 0; b < Dim; ++b) along += covariance[Chain::entry(a, b)] * rows[r][b];
          sum += along * rows[r][a];
        }
      }
    }
    return sum;
  }
};

template <int Dim>
struct Kernel {
  using Chain = lanes_v0_1::DifferenceChain<Dim, Lanes>;
  static constexpr int kEntries = Chain::kEntries;

  static void expect(const JointGroup& g, const DetectionSums* sums) {
    const Lanes *variances = lanes(g.variance), *offset = lanes(g.offset);
    if (sums != nullptr) {
      for (std::ptrdiff_t v = 0; v < g.views; ++v) {
        lanes(sums->square)[v] = lanes(sums->count)[v] = Lanes{};
        lanes(sums->shared)[v] = lanes(sums->neighbours)[v] = Lanes{};
        for (int r = 0; r < 2; ++r) {
          lanes(sums->errors)[v * 2 + r] = Lanes{};
          for (int c = 0; c < Dim; ++c) lanes(sums->rows)[(v * 2 + r) * Dim + c] = Lanes{};
        }
      }
    }
    for (std::ptrdiff_t t = 0; t < g.frames; ++t) {
      const Lanes *x = lanes(g.points) + t * Dim, *s = lanes(g.covariance) + t * kEntries;
      for (std::ptrdiff_t v = 0; v < g.views; ++v) {
        const std::ptrdiff_t i = t * g.views + v;
        const Residual<Dim> residual(g, t, v, x, false);
        const Lanes error[2] = {residual.error[0] + offset[v * 2], residual.error[1] + offset[v * 2 + 1]};
        const Lanes square = error[0] * error[0] + error[1] * error[1] + residual.blur(s);
        const Lanes doubt = g.doubt == nullptr ? Lanes{} + 1.0 : lanes(g.doubt)[i];
        const Lanes variance = variances[v] * doubt;
        const Lanes base = 1.0 + square / (kDetection * variance);  // to the power of 1 + kDetection / 2
        const double most = 1 / (kTwoPi * g.rarity[v]);             // it is in the image
        Lanes expected = less(variance, most), surprise = base;
        if constexpr (Dim == 2) {  // what the others predict, with the uncertainty that the motion leaves
          const Lanes others = greater(1.0 - lanes(g.weight)[i] * s[0], Lanes{} + 1e-3);
          expected = less(variance + s[0] / others, most);
          surprise = 1.0 + greater(square - 2.0 * s[0], Lanes{}) / (others * others * kDetection * expected);
        }
        const Lanes prior = lanes(g.prior)[i];
        const Lanes likelihood = prior / (kTwoPi * expected * surprise * surprise * surprise);
        const Lanes probability = likelihood / (likelihood + (1.0 - prior) * g.rarity[v] + 1e-300);
        const Lanes trust = probability * ((1 + 2 / kDetection) / base);
        lanes(g.probability)[i] = probability;
        lanes(g.trust)[i] = trust;
        if (sums == nullptr) continue;
        lanes(sums->square)[v] += trust * square / doubt;
        lanes(sums->count)[v] += probability;
        for (int r = 0; r < 2; ++r) {
          lanes(sums->errors)[v * 2 + r] += probability * residual.error[r];
          for (int c = 0; c < Dim; ++c)
            lanes(sums->rows)[(v * 2 + r) * Dim + c] += probability * residual.rows[r][c];
        }
        Lanes* before = lanes(sums->before) + v * 2;
        if (t > 0) {
          const Lanes both = probability * lanes(g.probability)[i - g.views];
          lanes(sums->neighbours)[v] += both;
          lanes(sums->shared)[v] += both * (residual.error[0] * before[0] + residual.error[1] * before[1]);
        }
        for (int r = 0; r < 2; ++r) before[r] = residual.error[r];
      }
    }
  }

  static void settle(const JointGroup& g, double* moved) {
    const std::ptrdiff_t changes = g.frames - 2;
    const Lanes scale = 1.0 / *lanes(g.motion), *x = lanes(g.points), *spread = lanes(g.spread);
    Lanes *square = lanes(g.change), *calm = lanes(g.calm), sum{};
    for (std::ptrdiff_t t = 0; t < changes; ++t) {
      const double* a = g.coefficients + t * 3;
      square[t] = spread[t];
      for (int c = 0; c < Dim; ++c) {
        const Lanes d = a[0] * x[t * Dim + c] + a[1] * x[(t + 1) * Dim + c] + a[2] * x[(t + 2) * Dim + c];
        square[t] += d * d;
      }
    }
    for (std::ptrdiff_t t = 0; t < changes; ++t) {
      const std::ptrdiff_t from = t > kBurst ? t - kBurst : 0;
      const std::ptrdiff_t to = t + kBurst < changes ? t + kBurst + 1 : changes;
      Lanes near{};
      for (std::ptrdiff_t k = from; k < to; ++k) near += square[k];
      calm[t] = (kMotion + Dim * static_cast<double>(to - from)) / (kMotion + near * scale);
      sum += calm[t] * square[t];
    }
    *lanes(moved) = sum;
  }

  static void reweigh(const JointGroup& g) {
    for (std::ptrdiff_t t = 0; t < g.frames; ++t) {
      for (std::ptrdiff_t v = 0; v < g.views; ++v) {
        const std::ptrdiff_t i = t * g.views + v;
        Lanes variance = lanes(g.variance)[v];
        if (g.doubt != nullptr) variance *= lanes(g.doubt)[i];
        const Lanes trust = lanes(g.trust)[i];
        lanes(g.weight)[i] = trust / variance;
        const Lanes most = (1 + 2 / kDetection) * lanes(g.probability)[i];  // trust where there is no error
        lanes(g.curvature)[i] = trust * trust / ((most + 1e-300) * variance);
      }
    }
  }

  static void evidence(const JointGroup& g, bool along_ray) {
    const Lanes *offset = lanes(g.offset), *weight = lanes(g.weight), weak = *lanes(g.weak);
    for (std::ptrdiff_t t = 0; t < g.frames; ++t) {
      const Lanes* x = lanes(g.points) + t * Dim;
      Lanes a[kEntries], b[Dim];
      for (int k = 0; k < kEntries; ++k) a[k] = Lanes{};
      for (int r = 0; r < Dim; ++r) {
        a[Chain::entry(r, r)] = weak;
        b[r] = weak * g.centre[r];
      }
      for (std::ptrdiff_t v = 0; v < g.views; ++v) {
        const Residual<Dim> residual(g, t, v, x, along_ray);
        for (int k = 0; k < 2; ++k) {
          const Lanes* row = residual.rows[k];
          Lanes goal = -(residual.error[k] + offset[v * 2 + k]);
          for (int c = 0; c < Dim; ++c) goal += row[c] * x[c];
          for (int r = 0; r < Dim; ++r) {
            const Lanes weighted = weight[t * g.views + v] * row[r];
            b[r] += weighted * goal;
            for (int c = r; c < Dim; ++c) a[Chain::entry(r, c)] += weighted * row[c];
          }
        }
      }
      for (int k = 0; k < kEntries; ++k) lanes(g.information)[t * kEntries + k] = a[k];
      for (int r = 0; r < Dim; ++r) lanes(g.right)[t * Dim + r] = b[r];
    }
  }

  static void posterior(const JointGroup& g, bool along_ray, double* moved, double* failed) {
    set_stiffness(g);
    evidence(g, along_ray);
    const Chain chain = factorized(g, failed);
    Lanes *path = lanes(g.path), *points = lanes(g.points), *covariance = lanes(g.covariance), sum{};
    for (std::ptrdiff_t k = 0; k < g.frames * Dim; ++k) {
      path[k] = lanes(g.right)[k];
      if (g.past != nullptr && k < 2 * Dim && g.frames > 1) path[k] += lanes(g.past_right)[k];
    }
    chain.solve(path);
    Lanes* change = lanes(g.change);
    for (std::ptrdiff_t t = 0; t < g.frames; ++t) change[t] = trace(covariance + t * kEntries);
    chain.covariance(covariance, lanes(g.spread));
    for (std::ptrdiff_t t = 0; t < g.frames; ++t) {
      const Lanes variance = trace(covariance + t * kEntries);
      Lanes way{};
      for (int c = 0; c < Dim; ++c) {
        const Lanes d = path[t * Dim + c] - points[t * Dim + c];
        way += d * d;
        points[t * Dim + c] = path[t * Dim + c];
      }
      sum += way / variance;
      change[t] = variance / change[t];
    }
    *lanes(moved) = sum;
  }

  static void add_lasting(const JointGroup& g, const double* deviation, double* failed) {
    set_stiffness(g);
    evidence(g, false);
    const Chain chain = factorized(g, failed);
    Lanes *path = lanes(g.path), *covariance = lanes(g.covariance);
    for (std::ptrdiff_t v = 0; v < g.views; ++v) {
      for (int k = 0; k < 2; ++k) {
        for (std::ptrdiff_t t = 0; t < g.frames; ++t) {
          const Residual<Dim> residual(g, t, v, lanes(g.points) + t * Dim, false);
          const std::ptrdiff_t i = t * g.views + v;
          for (int c = 0; c < Dim; ++c)
            path[t * Dim + c] = residual.rows[k][c] * lanes(g.weight)[i] * lanes(deviation)[i];
        }
        chain.solve(path);
        for (std::ptrdiff_t t = 0; t < g.frames; ++t) {
          for (int r = 0; r < Dim; ++r) {
            for (int c = r; c < Dim; ++c)
              covariance[t * kEntries + Chain::entry(r, c)] += path[t * Dim + r] * path[t * Dim + c];
          }
        }
      }
    }
  }

  static void log_evidence(const JointGroup& g, double* sum, double* failed) {
    set_stiffness(g);
    evidence(g, false);
    Lanes total{};
    const Lanes one = Lanes{} + 1.0;
    const auto multiply = [&](Lanes factor, double power) {
      for (int lane = 0; lane < ASTERISM_POSE_LANES; ++lane)
        total[lane] += power * __builtin_log(factor[lane]);
    };
    Chain chain{g.frames, 1, g.coefficients, lanes(g.inverse), lanes(g.next), lanes(g.second)};
    Lanes wrong{};
    const Lanes* past = g.past == nullptr ? nullptr : lanes(g.past);
    chain.factorize(lanes(g.information), lanes(g.stiffness), past, [&](Lanes pivot) {
      wrong += ((pivot > 0.0) & (pivot < 1e300)) ? Lanes{} : Lanes{} + 1.0;
      multiply(greater(pivot, one * 1e-300), -0.5);
    });
    *lanes(failed) = wrong;
    const Lanes *x = lanes(g.points), *offset = lanes(g.offset), motion = *lanes(g.motion);
    for (int r = 0; past != nullptr && g.frames > 1 && r < 2 * Dim; ++r) {
      total += lanes(g.past_right)[r] * x[r];
      for (int c = 0; c < 2 * Dim; ++c) total -= past[r * 2 * Dim + c] * x[r] * x[c] / 2.0;
    }
    for (std::ptrdiff_t t = 0; t < g.frames; ++t) {
      for (std::ptrdiff_t v = 0; v < g.views; ++v) {
        const std::ptrdiff_t i = t * g.views + v;
        const Residual<Dim> residual(g, t, v, x + t * Dim, false);
        Lanes square{};
        for (int r = 0; r < 2; ++r) {
          const Lanes error = residual.error[r] + offset[v * 2 + r];
          square += error * error;
        }
        const Lanes doubt = g.doubt == nullptr ? one : lanes(g.doubt)[i];
        const Lanes variance = lanes(g.variance)[v] * doubt, base = 1.0 + square / (kDetection * variance);
        const Lanes prior = lanes(g.prior)[i];
        multiply(prior / (kTwoPi * variance * base * base * base) + (1.0 - prior) * g.rarity[v], 1);
      }
    }
    for (std::ptrdiff_t t = 0; t < g.frames - 2; ++t) {
      const double* a = g.coefficients + t * 3;
      Lanes square{};
      for (int c = 0; c < Dim; ++c) {
        const Lanes d = a[0] * x[t * Dim + c] + a[1] * x[(t + 1) * Dim + c] + a[2] * x[(t + 2) * Dim + c];
        square += d * d;
      }
      multiply(1.0 + square / (kMotion * motion), -(kMotion + Dim) / 2.0);
      multiply(motion, -Dim / 2.0);
    }
    *lanes(sum) = total;
  }

 private:
  static void set_stiffness(const JointGroup& g) {
    const Lanes scale = 1.0 / *lanes(g.motion);
    Lanes greatest{};
    for (std::ptrdiff_t t = 0; t < g.frames - 2; ++t) {
      lanes(g.stiffness)[t] = lanes(g.calm)[t] * scale;
      const double* a = g.coefficients + t * 3;  // 1 in frames that are 1 apart, for any unit of time
      greatest = greater(greatest, lanes(g.stiffness)[t] * (a[0] * a[2]));
    }
    *lanes(g.weak) = greater(Lanes{} + g.least_weak, g.weak_share * greatest);
  }

  static Chain factorized(const JointGroup& g, double* failed) {
    Chain chain{g.frames, 1, g.coefficients, lanes(g.inverse), lanes(g.next), lanes(g.second)};
    Lanes wrong{};
    chain.factorize(
        lanes(g.information), lanes(g.stiffness), g.past == nullptr ? nullptr : lanes(g.past),
        [&](Lanes pivot) { wrong += ((pivot > 0.0) & (pivot < 1e300)) ? Lanes{} : Lanes{} + 1.0; });
    *lanes(failed) = wrong;
    return chain;
  }

  static Lanes trace(const Lanes* covariance) {
    Lanes sum = covariance[0];
    for (int r = 1; r < Dim; ++r) sum += covariance[Chain::entry(r, r)];
    return sum;
  }
};

template <int Dim>
constexpr Kernels kernels_of() {
  using K = Kernel<Dim>;
  return {ASTERISM_POSE_LANES, K::expect,    K::settle,      K::reweigh,
          K::evidence,         K::posterior, K::add_lasting, K::log_evidence};
}

}  // namespace
}  // namespace asterism::pose_kernels
