#pragma once

// The kernels of the part models' filters and of Fhog, in vectors of lanes. In the transforms of a filter,
// the lanes are its channels: these need no shuffles, and real input needs no special code. In those of a
// single plane, the lanes are its rows in the transform along the rows, and its columns in the other.
#include "part_lanes.hpp"

namespace asterism::part_kernels_v0_1 {
namespace {

// kLanes complex numbers at a time: real and imaginary parts of element i are at re + i * stride and im + i *
// stride. Exchanging re and im in both input and output gives the inverse transform.
struct Input {
  const float *re, *im;
  std::ptrdiff_t stride;
};
struct Output {
  float *re, *im;
  std::ptrdiff_t stride;
};

struct Complex {
  V re, im;
};

ASTERISM_INLINE Complex operator+(const Complex& a, const Complex& b) { return {a.re + b.re, a.im + b.im}; }
ASTERISM_INLINE Complex operator-(const Complex& a, const Complex& b) { return {a.re - b.re, a.im - b.im}; }
ASTERISM_INLINE Complex operator*(float a, const Complex& b) { return {a * b.re, a * b.im}; }
// a - i b and a + i b
ASTERISM_INLINE Complex minus_i(const Complex& a, const Complex& b) { return {a.re + b.im, a.im - b.re}; }
ASTERISM_INLINE Complex plus_i(const Complex& a, const Complex& b) { return {a.re - b.im, a.im + b.re}; }

/// Cosines and sines of 2 pi j / kRadix, j = 1 .. kRadix / 2, in all lanes: the factors of an odd radix above
/// 4, whose other roots differ from these only in sign.
template <int kRadix>
struct Roots {
  static constexpr bool kUsed = kRadix > 4 && kRadix % 2 != 0;
  V cosine[kUsed ? kRadix / 2 : 1], sine[kUsed ? kRadix / 2 : 1];

  ASTERISM_INLINED explicit Roots(const float* roots) {
    if constexpr (kUsed) {
      for (int j = 0; j < kRadix / 2; ++j) {
        cosine[j] = set(roots[j + 1]);
        sine[j] = set(roots[kRadix + j + 1]);
      }
    }
  }
};

/// x_k <- sum over j of exp(-2 pi i j k / kRadix) x_j
template <int kRadix, typename R>
ASTERISM_INLINE void butterfly(Complex* x, const R& roots) {
  if constexpr (kRadix == 2) {
    const Complex a = x[0];
    x[0] = a + x[1];
    x[1] = a - x[1];
  } else if constexpr (kRadix == 3) {
    const Complex sum = x[1] + x[2], difference = 0.866025404F * (x[1] - x[2]);
    const Complex rest = x[0] - 0.5F * sum;
    x[0] = x[0] + sum;
    x[1] = minus_i(rest, difference);
    x[2] = plus_i(rest, difference);
  } else if constexpr (kRadix == 4) {
    const Complex a = x[0] + x[2], b = x[0] - x[2], c = x[1] + x[3], d = x[1] - x[3];
    x[0] = a + c;
    x[1] = minus_i(b, d);
    x[2] = a - c;
    x[3] = plus_i(b, d);
  } else if constexpr (kRadix == 6) {
    // Three transforms of two points and two of three. No twiddle factors, as 2 and 3 are coprime.
    Complex a[3] = {x[0] + x[3], x[4] + x[1], x[2] + x[5]};
    Complex b[3] = {x[0] - x[3], x[4] - x[1], x[2] - x[5]};
    butterfly<3>(a, roots);
    butterfly<3>(b, roots);
    x[0] = a[0];
    x[2] = a[1];
    x[4] = a[2];
    x[3] = b[0];
    x[5] = b[1];
    x[1] = b[2];
  } else {
    constexpr int kHalf = kRadix / 2;
    Complex sums[kHalf], differences[kHalf];
    Complex total = x[0];
    for (int j = 0; j < kHalf; ++j) {
      sums[j] = x[j + 1] + x[kRadix - 1 - j];
      differences[j] = x[j + 1] - x[kRadix - 1 - j];
      total = total + sums[j];
    }
    const Complex first = x[0];
    x[0] = total;
#pragma GCC unroll 8
    for (int k = 1; k <= kHalf; ++k) {
      Complex a = first, b = {};
#pragma GCC unroll 8
      for (int j = 0; j < kHalf; ++j) {
        const int turns = (j + 1) * k % kRadix, folded = turns <= kHalf ? turns : kRadix - turns;
        const V cosine = roots.cosine[folded - 1], sine = roots.sine[folded - 1];
        a.re += cosine * sums[j].re;
        a.im += cosine * sums[j].im;
        if (turns == folded) {
          b.re += sine * differences[j].re;
          b.im += sine * differences[j].im;
        } else {
          b.re -= sine * differences[j].re;
          b.im -= sine * differences[j].im;
        }
      }
      x[k] = minus_i(a, b);
      x[kRadix - k] = plus_i(a, b);
    }
  }
}

/// Pass `index` of a transform: m times s transforms of kRadix points, of which the first s have no twiddle
/// factors.
template <int kRadix>
void pass(const Passes& plan, int index, int m, int s, const Input& in, const Output& out) {
  const Roots<kRadix> roots(plan.roots[index]);
  const std::ptrdiff_t in_step = in.stride * s * m, out_step = out.stride * s;
  const auto run = [&](int q, auto twiddle) ASTERISM_INLINED {
    const float *re = in.re + in.stride * s * q, *im = in.im + in.stride * s * q;
    float *to_re = out.re + out_step * kRadix * q, *to_im = out.im + out_step * kRadix * q;
    for (int t = 0; t < s; ++t) {
      Complex x[kRadix];
      for (int j = 0; j < kRadix; ++j) x[j] = {load(re + in_step * j), load(im + in_step * j)};
      butterfly<kRadix>(x, roots);
      store(to_re, x[0].re);
      store(to_im, x[0].im);
      for (int k = 1; k < kRadix; ++k) {
        const Complex y = twiddle(x[k], k);
        store(to_re + out_step * k, y.re);
        store(to_im + out_step * k, y.im);
      }
      re += in.stride;
      im += in.stride;
      to_re += out.stride;
      to_im += out.stride;
    }
  };
  run(0, [](const Complex& x, int) ASTERISM_INLINED { return x; });
  for (int q = 1; q < m; ++q) {
    const float* const w = plan.twiddles[index] + 2 * (kRadix - 1) * q;
    run(q, [w](const Complex& x, int k) ASTERISM_INLINED {
      const float re = w[2 * k - 2], im = w[2 * k - 1];
      return Complex{x.re * re - x.im * im, x.re * im + x.im * re};
    });
  }
}

/// The same for any odd radix that has no butterfly of its own.
void any_pass(const Passes& plan, int index, int m, int s, const Input& in, const Output& out) {
  const int radix = plan.radix[index];
  const float* const roots = plan.roots[index];
  for (int q = 0; q < m; ++q) {
    const float* const w = plan.twiddles[index] + 2 * (radix - 1) * q;
    for (int t = 0; t < s; ++t) {
      const auto at = [&](int j) ASTERISM_INLINED {
        const std::ptrdiff_t i = in.stride * (t + std::ptrdiff_t{s} * (q + m * j));
        return Complex{load(in.re + i), load(in.im + i)};
      };
      const auto put = [&](int k, const Complex& x) ASTERISM_INLINED {
        const std::ptrdiff_t i = out.stride * (t + std::ptrdiff_t{s} * (radix * q + k));
        const float re = k > 0 ? w[2 * k - 2] : 1, im = k > 0 ? w[2 * k - 1] : 0;
        store(out.re + i, x.re * re - x.im * im);
        store(out.im + i, x.re * im + x.im * re);
      };
      // Here the input must not be overwritten: see `transform`.
      Complex total = at(0);
      for (int j = 1; j < radix; ++j) total = total + at(j);
      put(0, total);
      for (int k = 1; 2 * k < radix; ++k) {
        Complex a = at(0), b = {};
        for (int j = 1, turns = k; 2 * j < radix; ++j, turns = (turns + k) % radix) {
          const Complex one = at(j), other = at(radix - j);
          a = a + roots[turns] * (one + other);
          b = b + roots[radix + turns] * (one - other);
        }
        put(k, minus_i(a, b));
        put(radix - k, plus_i(a, b));
      }
    }
  }
}

/// in -> out, which may be the same memory; work: 4 n kLanes floats.
[[gnu::noinline]] void transform(const Passes& plan, const Input& in, const Output& out, float* work) {
  const std::ptrdiff_t stride = 2 * kLanes;
  const Output buffers[2] = {{work, work + kLanes, stride},
                             {work + stride * plan.points, work + stride * plan.points + kLanes, stride}};
  Input from = in;
  int m = plan.points, s = 1;
  for (int index = 0; index < plan.count; ++index) {
    const int radix = plan.radix[index];
    m /= radix;
    const Output to = index + 1 == plan.count ? out : buffers[index % 2];
    switch (radix) {
      case 2:
        pass<2>(plan, index, m, s, from, to);
        break;
      case 3:
        pass<3>(plan, index, m, s, from, to);
        break;
      case 4:
        pass<4>(plan, index, m, s, from, to);
        break;
      case 5:
        pass<5>(plan, index, m, s, from, to);
        break;
      case 6:
        pass<6>(plan, index, m, s, from, to);
        break;
      case 7:
        pass<7>(plan, index, m, s, from, to);
        break;
      case 11:
        pass<11>(plan, index, m, s, from, to);
        break;
      case 13:
        pass<13>(plan, index, m, s, from, to);
        break;
      default:
        any_pass(plan, index, m, s, from, to);
        break;
    }
    s *= radix;
    from = {to.re, to.im, to.stride};
  }
}

/// `cols` real numbers at `row`, kLanes of them side by side -> their bins; z: a buffer of cols / 2 elements.
/// Even and odd numbers become the real and imaginary parts of a transform of half the size.
void forward_row(const Transform& t, const float* row, const Output& out, float* z, float* work) {
  const int half = t.cols / 2;
  transform(t.across, {row, row + kLanes, 2 * kLanes}, {z, z + kLanes, 2 * kLanes}, work);
  const auto at = [&](int k) ASTERISM_INLINED {
    return Complex{load(z + 2 * kLanes * k), load(z + 2 * kLanes * k + kLanes)};
  };
  const auto put = [&](int k, V re, V im) ASTERISM_INLINED {
    store(out.re + out.stride * k, re);
    store(out.im + out.stride * k, im);
  };
  const Complex dc = at(0);
  put(0, dc.re + dc.im, V{});
  put(half, dc.re - dc.im, V{});
  for (int k = 1; 2 * k <= half; ++k) {
    const Complex a = at(k), b = at(half - k);
    // Transforms of the even numbers, E = (a + b*) / 2, and of the odd ones, O = -i (a - b*) / 2.
    const V even_re = 0.5F * (a.re + b.re), even_im = 0.5F * (a.im - b.im);
    const V odd_re = 0.5F * (a.im + b.im), odd_im = 0.5F * (b.re - a.re);
    const float re = t.real_twiddles[2 * k], im = t.real_twiddles[2 * k + 1];
    const V turned_re = odd_re * re - odd_im * im, turned_im = odd_re * im + odd_im * re;
    put(k, even_re + turned_re, even_im + turned_im);
    put(half - k, even_re - turned_re, turned_im - even_im);
  }
}

/// The inverse, divided by rows x cols.
void inverse_row(const Transform& t, const Input& in, float* row, float* z, float* work) {
  const int half = t.cols / 2;
  const float scale = 1 / (static_cast<float>(t.rows) * static_cast<float>(t.cols));
  const auto at = [&](int k) ASTERISM_INLINED {
    return Complex{load(in.re + in.stride * k), load(in.im + in.stride * k)};
  };
  const auto put = [&](int k, V re, V im) ASTERISM_INLINED {
    store(z + 2 * kLanes * k, scale * re);
    store(z + 2 * kLanes * k + kLanes, scale * im);
  };
  const V dc = at(0).re, nyquist = at(half).re;
  put(0, dc + nyquist, dc - nyquist);
  for (int k = 1; 2 * k <= half; ++k) {
    const Complex a = at(k), b = at(half - k);
    const V even_re = a.re + b.re, even_im = a.im - b.im;
    const V turned_re = a.re - b.re, turned_im = a.im + b.im;
    const float re = t.real_twiddles[2 * k], im = t.real_twiddles[2 * k + 1];
    const V odd_re = turned_re * re + turned_im * im, odd_im = turned_im * re - turned_re * im;
    put(k, even_re - odd_im, even_im + odd_re);
    put(half - k, even_re + odd_im, odd_re - even_im);
  }
  transform(t.across, {z + kLanes, z, 2 * kLanes}, {row + kLanes, row, 2 * kLanes}, work);
}

// The buffers into which the functions below divide their workspace.
struct Work {
  float *passes, *z, *rows;
  Work(const Transform& t, float* work) {
    const std::ptrdiff_t longest = t.rows > t.cols ? t.rows : t.cols;
    passes = work;
    z = passes + 4 * kLanes * longest;
    rows = z + std::ptrdiff_t{kLanes} * t.cols;
  }
};

double forward(const Transform& t, int channels, const float* planes, const float* window, float* spectra,
               float* work) {
  const Work buffers(t, work);
  const std::ptrdiff_t plane = std::ptrdiff_t{t.rows} * t.cols, row_stride = 2 * kLanes * t.bins;
  const std::ptrdiff_t four_rows = std::ptrdiff_t{4} * t.cols;  // a multiple of 16: vectors are full
  double norm = 0;
  for (int channel = 0; channel < channels; channel += kLanes) {
    float* const block = spectra + row_stride * t.rows * (channel / kLanes);
    for (int row = 0; row < t.rows; row += 4) {
      const std::ptrdiff_t first = std::ptrdiff_t{row} * t.cols;
      V squares = {};
      for (std::ptrdiff_t i = 0; i < four_rows; i += kLanes) {
        const V weight = load(window + first + i);
        const float* const source = planes + plane * channel + first + i;
        V v[kLanes];
#pragma GCC unroll 16
        for (int c = 0; c < kLanes; ++c) {
          v[c] = load(source + plane * c) * weight;
          squares += v[c] * v[c];
        }
        transpose(v);
#pragma GCC unroll 16
        for (int c = 0; c < kLanes; ++c) store(buffers.rows + kLanes * (i + c), v[c]);
      }
      norm += sum(squares);
      for (int r = 0; r < 4; ++r) {
        float* const bins = block + row_stride * (row + r);
        forward_row(t, buffers.rows + std::ptrdiff_t{kLanes} * r * t.cols, {bins, bins + kLanes, 2 * kLanes},
                    buffers.z, buffers.passes);
      }
    }
    for (int bin = 0; bin < t.bins; ++bin) {
      float* const column = block + std::ptrdiff_t{2} * kLanes * bin;
      transform(t.down, {column, column + kLanes, row_stride}, {column, column + kLanes, row_stride},
                buffers.passes);
    }
  }
  return norm;
}

void correlate(const Transform& t, int channels, const float* z, const float* x, float* cross) {
  const std::ptrdiff_t block = std::ptrdiff_t{2} * kLanes * t.bins * t.rows;
  const std::ptrdiff_t imaginary = std::ptrdiff_t{t.padded_rows} * t.padded_bins;
  const int blocks = channels / kLanes;
  for (int row = 0; row < t.rows; ++row) {
    for (int bin = 0; bin < t.bins; bin += kLanes) {
      V re[kLanes] = {}, im[kLanes] = {};
      const int count = t.bins - bin < kLanes ? t.bins - bin : kLanes;
      for (int b = 0; b < count; ++b) {
        const std::ptrdiff_t at = 2 * kLanes * (std::ptrdiff_t{row} * t.bins + bin + b);
        V sum_re = {}, sum_im = {};
        for (int k = 0; k < blocks; ++k) {
          const float *const a = z + at + block * k, *const c = x + at + block * k;
          const V a_re = load(a), a_im = load(a + kLanes), c_re = load(c), c_im = load(c + kLanes);
          sum_re += a_re * c_re + a_im * c_im;
          sum_im += a_im * c_re - a_re * c_im;
        }
        re[b] = sum_re;
        im[b] = sum_im;
      }
      float* const to = cross + std::ptrdiff_t{row} * t.padded_bins + bin;
      store(to, sums(re));
      store(to + imaginary, sums(im));
    }
  }
}

double train(const Transform& t, int channels, float rate, const float* sample, float* templates,
             float* power) {
  const std::ptrdiff_t block = std::ptrdiff_t{2} * kLanes * t.bins * t.rows;
  const int blocks = channels / kLanes;
  double norm = 0;
  for (int row = 0; row < t.rows; ++row) {
    V inner = {}, ends = {};
    for (int bin = 0; bin < t.bins; bin += kLanes) {
      V energy[kLanes] = {};
      const int count = t.bins - bin < kLanes ? t.bins - bin : kLanes;
      for (int b = 0; b < count; ++b) {
        const std::ptrdiff_t at = 2 * kLanes * (std::ptrdiff_t{row} * t.bins + bin + b);
        V of_sample = {}, of_template = {};
        for (int k = 0; k < blocks; ++k) {
          const float* const s = sample + at + block * k;
          float* const z = templates + at + block * k;
          const V re = load(s), im = load(s + kLanes);
          V z_re = load(z), z_im = load(z + kLanes);
          z_re += rate * (re - z_re);
          z_im += rate * (im - z_im);
          store(z, z_re);
          store(z + kLanes, z_im);
          of_sample += re * re + im * im;
          of_template += z_re * z_re + z_im * z_im;
        }
        energy[b] = of_sample;
        // By Parseval; each bin except the first and the last stands for two of the full spectrum.
        if (bin + b == 0 || bin + b == t.bins - 1)
          ends += of_template;
        else
          inner += of_template;
      }
      store(power + std::ptrdiff_t{row} * t.padded_bins + bin, sums(energy));
    }
    norm += 2 * sum(inner) + sum(ends);
  }
  float* const imaginary = power + std::ptrdiff_t{t.padded_rows} * t.padded_bins;
  for (std::ptrdiff_t i = 0; i < std::ptrdiff_t{t.rows} * t.padded_bins; i += kLanes)
    store(imaginary + i, V{});
  return norm / (static_cast<double>(t.rows) * t.cols);
}

/// Solves (x x^H + ridge I) f = x y + ridge b in each bin, with b = (gamma g - h + mu f_prev) / (gamma + mu),
/// by Sherman and Morrison: f = b + x (y - x^H b) / (|x|^2 + ridge).
template <bool kFirst, bool kLast>
double regress_as(const Transform& t, const RegressionRound& round) {
  const std::ptrdiff_t block = std::ptrdiff_t{2} * kLanes * t.bins * t.rows;
  const int blocks = round.channels / kLanes;
  const float whole = round.penalty + round.temporal;
  const float of_constrained = round.penalty / whole, of_multiplier = 1 / whole,
              of_previous = round.temporal / whole;
  const float ridge = whole * static_cast<float>(t.rows) * static_cast<float>(t.cols);
  double response = 0;
  for (int row = 0; row < t.rows; ++row) {
    V all = {};
    float ends = 0;
    for (int bin = 0; bin < t.bins; bin += kLanes) {
      V energy[kLanes] = {}, re[kLanes] = {}, im[kLanes] = {};
      const int count = t.bins - bin < kLanes ? t.bins - bin : kLanes;
      const std::ptrdiff_t first = 2 * kLanes * (std::ptrdiff_t{row} * t.bins + bin);
      for (int b = 0; b < count; ++b) {
        V sum = {}, sum_re = {}, sum_im = {};
        for (int k = 0; k < blocks; ++k) {
          const std::ptrdiff_t at = first + 2 * kLanes * b + block * k;
          const float *const x = round.sample + at, *const old = round.previous + at;
          float* const f = round.filter + at;
          V b_re = of_previous * load(old), b_im = of_previous * load(old + kLanes);
          if constexpr (!kFirst) {
            const float* const g = round.constrained + at;
            float* const h = round.multiplier + at;
            const V g_re = load(g), g_im = load(g + kLanes);
            const V h_re = load(h) + round.last_penalty * (load(f) - g_re);
            const V h_im = load(h + kLanes) + round.last_penalty * (load(f + kLanes) - g_im);
            if constexpr (!kLast) {
              store(h, h_re);
              store(h + kLanes, h_im);
            }
            b_re += of_constrained * g_re - of_multiplier * h_re;
            b_im += of_constrained * g_im - of_multiplier * h_im;
          }
          store(f, b_re);
          store(f + kLanes, b_im);
          const V x_re = load(x), x_im = load(x + kLanes);
          sum += x_re * x_re + x_im * x_im;
          sum_re += x_re * b_re + x_im * b_im;
          sum_im += x_re * b_im - x_im * b_re;
        }
        energy[b] = sum;
        re[b] = sum_re;
        im[b] = sum_im;
      }
      // One bin a lane: x^H b, and the factor of x in f.
      const V power = sums(energy), fit_re = sums(re), fit_im = sums(im);
      const V share = 1.0F / (power + ridge);
      float factor_re[kLanes], factor_im[kLanes];
      const V q_re = (load(round.label + std::ptrdiff_t{row} * t.padded_bins + bin) - fit_re) * share;
      store(factor_re, q_re);
      store(factor_im, -fit_im * share);
      // The real part of the response, x^H f; each bin except the first and the last stands for two.
      const V reached = fit_re + power * q_re;
      all += reached;
      if (bin == 0) ends += reached[0];
      if (bin + count == t.bins) ends += reached[count - 1];
      for (int b = 0; b < count; ++b) {
        const V by_re = set(factor_re[b]), by_im = set(factor_im[b]);
        for (int k = 0; k < blocks; ++k) {
          const std::ptrdiff_t at = first + 2 * kLanes * b + block * k;
          const float* const x = round.sample + at;
          float* const f = round.filter + at;
          const V x_re = load(x), x_im = load(x + kLanes);
          const V f_re = load(f) + (x_re * by_re - x_im * by_im);
          const V f_im = load(f + kLanes) + (x_re * by_im + x_im * by_re);
          store(f, f_re);
          store(f + kLanes, f_im);
          if constexpr (!kLast) {
            float *const g = round.constrained + at, *const h = round.multiplier + at;
            if constexpr (kFirst) {
              store(h, V{});
              store(h + kLanes, V{});
              store(g, round.penalty * f_re);
              store(g + kLanes, round.penalty * f_im);
            } else {
              store(g, round.penalty * f_re + load(h));
              store(g + kLanes, round.penalty * f_im + load(h + kLanes));
            }
          }
        }
      }
    }
    response += 2 * sum(all) - static_cast<double>(ends);
  }
  return response / (static_cast<double>(t.rows) * t.cols);
}

double regress(const Transform& t, const RegressionRound& round) {
  if (round.last_penalty == 0)
    return round.last ? regress_as<true, true>(t, round) : regress_as<true, false>(t, round);
  return round.last ? regress_as<false, true>(t, round) : regress_as<false, false>(t, round);
}

void weigh(const Transform& t, int channels, const float* weight, float* spectra, float* work) {
  const Work buffers(t, work);
  const std::ptrdiff_t row_stride = std::ptrdiff_t{2} * kLanes * t.bins;
  for (int channel = 0; channel < channels; channel += kLanes) {
    float* const block = spectra + row_stride * t.rows * (channel / kLanes);
    for (int bin = 0; bin < t.bins; ++bin) {
      float *const re = block + std::ptrdiff_t{2} * kLanes * bin, *const im = re + kLanes;
      transform(t.down, {im, re, row_stride}, {im, re, row_stride}, buffers.passes);
    }
    for (int row = 0; row < t.rows; ++row) {
      float* const bins = block + row_stride * row;
      const float* const weights = weight + std::ptrdiff_t{row} * t.cols;
      bool zero = true;
      for (int col = 0; col < t.cols; ++col) zero = zero && weights[col] == 0;
      if (zero) {
        for (std::ptrdiff_t i = 0; i < row_stride; i += kLanes) store(bins + i, V{});
        continue;
      }
      inverse_row(t, {bins, bins + kLanes, 2 * kLanes}, buffers.rows, buffers.z, buffers.passes);
      for (int col = 0; col < t.cols; ++col) {
        float* const at = buffers.rows + std::ptrdiff_t{kLanes} * col;
        store(at, load(at) * weights[col]);
      }
      forward_row(t, buffers.rows, {bins, bins + kLanes, 2 * kLanes}, buffers.z, buffers.passes);
    }
    for (int bin = 0; bin < t.bins; ++bin) {
      float* const column = block + std::ptrdiff_t{2} * kLanes * bin;
      transform(t.down, {column, column + kLanes, row_stride}, {column, column + kLanes, row_stride},
                buffers.passes);
    }
  }
}

/// Columns of a split spectrum, in place.
ASTERISM_INLINE void transform_columns(const Transform& t, float* re, float* im, float* work) {
  for (int bin = 0; bin < t.padded_bins; bin += kLanes) {
    transform(t.down, {re + bin, im + bin, t.padded_bins}, {re + bin, im + bin, t.padded_bins}, work);
  }
}

void inverse_plane(const Transform& t, float* split, float* plane, float* work) {
  const Work buffers(t, work);
  float* const imaginary = split + std::ptrdiff_t{t.padded_rows} * t.padded_bins;
  transform_columns(t, imaginary, split, buffers.passes);
  for (int row = 0; row < t.rows; row += kLanes) {
    for (int bin = 0; bin < t.padded_bins; bin += kLanes) {
      for (int second = 0; second < 2; ++second) {
        const float* const source =
            (second == 1 ? imaginary : split) + std::ptrdiff_t{row} * t.padded_bins + bin;
        V v[kLanes];
#pragma GCC unroll 16
        for (int r = 0; r < kLanes; ++r) v[r] = load(source + std::ptrdiff_t{t.padded_bins} * r);
        transpose(v);
        float* const to = buffers.rows + 2 * kLanes * bin + kLanes * second;
#pragma GCC unroll 16
        for (int b = 0; b < kLanes; ++b) store(to + 2 * kLanes * b, v[b]);
      }
    }
    inverse_row(t, {buffers.rows, buffers.rows + kLanes, 2 * kLanes}, plane + std::ptrdiff_t{row} * t.cols,
                buffers.z, buffers.passes);
  }
}

void forward_plane(const Transform& t, const float* plane, float* split, float* work) {
  const Work buffers(t, work);
  float* const imaginary = split + std::ptrdiff_t{t.padded_rows} * t.padded_bins;
  for (int row = 0; row < t.rows; row += kLanes) {
    forward_row(t, plane + std::ptrdiff_t{row} * t.cols, {buffers.rows, buffers.rows + kLanes, 2 * kLanes},
                buffers.z, buffers.passes);
    for (int bin = t.bins; bin < t.padded_bins; ++bin) {
      store(buffers.rows + 2 * kLanes * bin, V{});
      store(buffers.rows + 2 * kLanes * bin + kLanes, V{});
    }
    for (int bin = 0; bin < t.padded_bins; bin += kLanes) {
      for (int second = 0; second < 2; ++second) {
        const float* const source = buffers.rows + 2 * kLanes * bin + kLanes * second;
        V v[kLanes];
#pragma GCC unroll 16
        for (int b = 0; b < kLanes; ++b) v[b] = load(source + 2 * kLanes * b);
        transpose(v);
        float* const to = (second == 1 ? imaginary : split) + std::ptrdiff_t{row} * t.padded_bins + bin;
#pragma GCC unroll 16
        for (int r = 0; r < kLanes; ++r) store(to + std::ptrdiff_t{t.padded_bins} * r, v[r]);
      }
    }
  }
  transform_columns(t, split, imaginary, buffers.passes);
}

void gaussian(float norms, float factor, std::ptrdiff_t count, float* plane) {
  for (std::ptrdiff_t i = 0; i < count; i += kLanes) {
    const V distance = max(norms - 2.0F * load(plane + i), V{});
    store(plane + i, exp_minus_one(max(-(distance * factor), set(-87.0F))));
  }
}

// --------------------------------------------------------------------------------------------------- fHOG

constexpr int kSigned = 18, kUnsigned = 9;

// Slope |gy| / |gx| above which direction k + 1 has a larger projection than direction k, k = 0..3.
constexpr float kSlopes[4] = {(1.0000F - 0.9397F) / 0.3420F, (0.9397F - 0.7660F) / (0.6428F - 0.3420F),
                              (0.7660F - 0.5000F) / (0.8660F - 0.6428F),
                              (0.5000F - 0.1736F) / (0.9848F - 0.8660F)};

template <typename Cell>
ASTERISM_INLINE void vote(const VoteRow& row, Cell cell) {
  const int half = cell / 2, width = row.width;
  const float* const magnitude = row.magnitude;
  const std::int32_t* const slot = row.slot;
  // One phase at a time: consecutive votes then go to different entries and do not wait for each other.
  for (int phase = 0; phase < cell; ++phase) {
    const Quad weights = reinterpret_cast<const UnalignedQuad*>(row.weights + 4 * phase)->v;
    // Interval i has the pixels half + (i - 1) cell + phase.
    int x = half - cell + phase;
    float* votes = row.votes;
    if (x < 0) {
      x += cell;
      votes += 4;
    }
#pragma GCC unroll 4
    for (; x < width; x += cell, votes += 4) {
      Quad* const entry = reinterpret_cast<Quad*>(votes + slot[x]);
      *entry += magnitude[x] * weights;
    }
  }
}

void vote_row(const VoteRow& row) {
  // Fold into the first quadrant, count the slopes exceeded (k = 0..4: 0, 20, .. 80 degrees), unfold:
  // k, 9 - k, 9 + k, 18 - k in the four quadrants. A half turn adds 9.
  const Ints stride = Ints{} + 4 * row.slot_stride;
  const float *const above = row.above, *const here = row.here, *const below = row.below;
  float* const magnitude = row.magnitude;
  std::int32_t* const slot = row.slot;
  const int width = row.width;
  for (int x = 0; x < width; x += kLanes) {
    const V gx = load(here + x + 2) - load(here + x), gy = load(below + x) - load(above + x);
    const V ax = abs(gx), ay = abs(gy);
    Ints k = {};
    for (const float slope : kSlopes) k -= Ints(ay > ax * slope);
    // If gx = 0, then 80 and 100 degrees tie; the first wins, whatever the sign of gy.
    const Ints down = bits(gy) >> 31, mirrored = (bits(gx + 1e-9F * gy) >> 31) ^ down;
    store(slot + x, (((k ^ mirrored) - mirrored) + (mirrored & kUnsigned) + (down & kUnsigned)) * stride);
    store(magnitude + x, sqrt(gx * gx + gy * gy));
  }
  struct Four {
    constexpr operator int() const { return 4; }
  };
  if (row.cell_size == 4)
    vote(row, Four());
  else
    vote(row, row.cell_size);
}

void collect(float* votes, int intervals, int cells, std::ptrdiff_t stride, float* open, float* done,
             float* energy) {
  // An entry is left top, left bottom, right top, right bottom. A gradient between -10 and 0 degrees is in
  // slot 18, which is orientation 0 again.
  float* const extra = votes + std::ptrdiff_t{4} * kSigned * intervals;
  for (int i = 0; i < 4 * intervals; i += 4) {
    *reinterpret_cast<Quad*>(votes + i) += *reinterpret_cast<Quad*>(extra + i);
    *reinterpret_cast<Quad*>(extra + i) = Quad{};
  }
  for (int o = 0; o < kSigned; ++o) {
    float* const v = votes + std::ptrdiff_t{4} * o * intervals;
    float *const of_open = open + o * stride, *const of_done = done + o * stride;
    int c = 0;
    for (; c + kLanes <= cells; c += kLanes) {
      // From the right half of entry c on: pairs (top, bottom), alternately from the right of an entry and
      // the left of the next, one cell after the other.
      const float* const from = v + 4 * c + 2;
      const V a = load(from), b = load(from + kLanes), d = load(from + 2 * kLanes),
              e = load(from + 3 * kLanes);
      V top, bottom;
      sum_pairs(a, b, d, e, top, bottom);
      store(of_done + c, load(of_open + c) + top);
      store(of_open + c, bottom);
    }
    for (; c < cells; ++c) {
      of_done[c] = of_open[c] + (v[4 * c + 2] + v[4 * c + 4]);
      of_open[c] = v[4 * c + 3] + v[4 * c + 5];
    }
  }
  for (int i = 0; i < 4 * kSigned * intervals; i += 8) {
    *reinterpret_cast<Quad*>(votes + i) = Quad{};
    *reinterpret_cast<Quad*>(votes + i + 4) = Quad{};
  }
  for (int c = 0; c < cells; c += kLanes) {  // rows are padded
    V total = {};
    for (int o = 0; o < kUnsigned; ++o) {
      const V h = load(done + o * stride + c) + load(done + (o + kUnsigned) * stride + c);
      total += h * h;
    }
    store(energy + c, total);
  }
}

void emit_row(const CellRow& row) {
  // The factor 1/2 of the features is applied before clipping, hence the clip at 0.1 and the doubled texture
  // factor.
  const V clip = set(0.1F);
  const auto emit = [&](int c, float* to, std::ptrdiff_t plane) ASTERISM_INLINED {
    const V n0 = 0.5F * load(row.lower + c + 1), n1 = 0.5F * load(row.upper + c + 1);
    const V n2 = 0.5F * load(row.lower + c), n3 = 0.5F * load(row.upper + c);
    V t0 = {}, t1 = {}, t2 = {}, t3 = {};
    const auto orientation = [&](int o) ASTERISM_INLINED {
      const V h = load(row.histogram + o * row.stride + c);
      const V p0 = min(h * n0, clip), p1 = min(h * n1, clip), p2 = min(h * n2, clip), p3 = min(h * n3, clip);
      t0 += p0;
      t1 += p1;
      t2 += p2;
      t3 += p3;
      store(to + o * plane, (p0 + p1) + (p2 + p3));
      return h;
    };
    for (int o = 0; o < kUnsigned; ++o) {
      const V h = orientation(o) + orientation(o + kUnsigned);
      store(to + (kSigned + o) * plane,
            (min(h * n0, clip) + min(h * n1, clip)) + (min(h * n2, clip) + min(h * n3, clip)));
    }
    constexpr float kTexture = 2 * 0.2357F;
    store(to + 27 * plane, kTexture * t0);
    store(to + 28 * plane, kTexture * t1);
    store(to + 29 * plane, kTexture * t2);
    store(to + 30 * plane, kTexture * t3);
  };
  if (row.cells >= kLanes) {
    for (int c = 0; c + kLanes <= row.cells; c += kLanes) emit(c, row.features + c, row.plane);
    // The last kLanes cells, some of them a second time.
    if (row.cells % kLanes != 0) emit(row.cells - kLanes, row.features + row.cells - kLanes, row.plane);
  } else {
    float features[31 * kLanes];
    emit(0, features, kLanes);
    for (int channel = 0; channel < 31; ++channel) {
      for (int c = 0; c < row.cells; ++c)
        row.features[channel * row.plane + c] = features[channel * kLanes + c];
    }
  }
}

// ------------------------------------------------------------------------------------------------ sampling

void sample_row(const SampledRow& row) {
  // Without local copies and __restrict nothing is vectorised: the bytes and integers might alias anything,
  // even `row`.
  const std::uint8_t* __restrict const above = row.above, * __restrict const below = row.below;
  const std::int32_t* __restrict const column = row.column, * __restrict const fraction = row.fraction;
  std::int32_t* __restrict const work = row.work;
  std::uint8_t* __restrict const out = row.out;
  const int first = row.first, last = row.last, limit = row.limit;
  const int run_first = row.run_first, run_end = row.run_end, width = row.width;
  const std::int32_t lower = row.blend, upper = 32 - lower;
  for (int x = first; x <= last; ++x) work[x] = upper * above[x] + lower * below[x];
  if (last + 1 == limit) work[limit] = work[last];
  const auto some = [&](int begin, int end) ASTERISM_INLINED {
    for (int x = begin; x < end; ++x) {
      const std::int32_t left = work[column[x]], right = work[column[x] + 1];
      out[x] = static_cast<std::uint8_t>((32 * left + fraction[x] * (right - left) + 512) >> 10);
    }
  };
  some(0, run_first);
  if (run_end > run_first) {
    const std::int32_t* __restrict const from = work + column[run_first];
    const std::int32_t right = fraction[run_first], left = 32 - right;
    std::uint8_t* __restrict const to = out + run_first;
    for (int i = 0; i < run_end - run_first; ++i) {
      to[i] = static_cast<std::uint8_t>((left * from[i] + right * from[i + 1] + 512) >> 10);
    }
  }
  some(run_end, width);
}

void cell_sums(const std::uint8_t* pixels, std::ptrdiff_t stride, int cell, int cells,
               std::int32_t* __restrict work, std::int32_t* __restrict sums) {
  const int width = cell * cells;
  for (int x = 0; x < width; ++x) work[x] = pixels[x];
  for (int y = 1; y < cell; ++y) {
    const std::uint8_t* __restrict const row = pixels + y * stride;
    for (int x = 0; x < width; ++x) work[x] += row[x];
  }
  if (cell == 4) {
    for (int c = 0; c < cells; ++c)
      sums[c] = work[4 * c] + work[4 * c + 1] + work[4 * c + 2] + work[4 * c + 3];
  } else {
    for (int c = 0; c < cells; ++c) {
      sums[c] = 0;
      for (int x = 0; x < cell; ++x) sums[c] += work[c * cell + x];
    }
  }
}

constexpr KernelSet kKernels = {.lanes = kLanes,
                                .forward = forward,
                                .correlate = correlate,
                                .train = train,
                                .regress = regress,
                                .weigh = weigh,
                                .inverse_plane = inverse_plane,
                                .forward_plane = forward_plane,
                                .gaussian = gaussian,
                                .vote_row = vote_row,
                                .collect = collect,
                                .emit_row = emit_row,
                                .sample_row = sample_row,
                                .cell_sums = cell_sums};

}  // namespace
}  // namespace asterism::part_kernels_v0_1
