#include <fftw3.h>

#include <array>
#include <asterism/parts/fft.hpp>
#include <cstdlib>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <new>
#include <stdexcept>
#include <string>
#include <tuple>

namespace asterism::inline ASTERISM_ABI {
namespace {

// The two precisions of FFTW under common names.
template <typename Scalar>
struct Fftw;

template <>
struct Fftw<float> {
  using Plan = fftwf_plan;
  using Complex = fftwf_complex;
  static constexpr auto plan_r2c = fftwf_plan_many_dft_r2c;
  static constexpr auto plan_c2r = fftwf_plan_many_dft_c2r;
  static constexpr auto execute_r2c = fftwf_execute_dft_r2c;
  static constexpr auto execute_c2r = fftwf_execute_dft_c2r;
  static constexpr auto destroy = fftwf_destroy_plan;
  static constexpr auto allocate = fftwf_malloc;
  static constexpr auto deallocate = fftwf_free;
  static constexpr auto alignment_of = fftwf_alignment_of;
  static constexpr auto export_wisdom = fftwf_export_wisdom_to_string;
  static constexpr auto import_wisdom = fftwf_import_wisdom_from_string;
  static constexpr auto forget_wisdom = fftwf_forget_wisdom;
};

template <>
struct Fftw<double> {
  using Plan = fftw_plan;
  using Complex = fftw_complex;
  static constexpr auto plan_r2c = fftw_plan_many_dft_r2c;
  static constexpr auto plan_c2r = fftw_plan_many_dft_c2r;
  static constexpr auto execute_r2c = fftw_execute_dft_r2c;
  static constexpr auto execute_c2r = fftw_execute_dft_c2r;
  static constexpr auto destroy = fftw_destroy_plan;
  static constexpr auto allocate = fftw_malloc;
  static constexpr auto deallocate = fftw_free;
  static constexpr auto alignment_of = fftw_alignment_of;
  static constexpr auto export_wisdom = fftw_export_wisdom_to_string;
  static constexpr auto import_wisdom = fftw_import_wisdom_from_string;
  static constexpr auto forget_wisdom = fftw_forget_wisdom;
};

// FFTW's planner is not thread-safe; executing a plan is.
std::mutex& planner_mutex() {
  static std::mutex mutex;
  return mutex;
}

// FFTW remembers how it planned earlier transforms ("wisdom"), also those that the program planned with
// FFTW_MEASURE, and prefers that to an estimate. Setting it aside while we plan makes our plans, and with
// them the rounding of our results, depend on the sizes alone.
template <typename Scalar>
class WisdomSetAside {
 public:
  WisdomSetAside() : wisdom_(Fftw<Scalar>::export_wisdom()) { Fftw<Scalar>::forget_wisdom(); }
  ~WisdomSetAside() {
    Fftw<Scalar>::forget_wisdom();
    if (wisdom_ != nullptr) Fftw<Scalar>::import_wisdom(wisdom_);
    std::free(wisdom_);
  }
  WisdomSetAside(const WisdomSetAside&) = delete;
  WisdomSetAside& operator=(const WisdomSetAside&) = delete;

 private:
  char* wisdom_;
};

}  // namespace

template <typename Scalar>
struct RealFft2<Scalar>::Plans {
  using Api = Fftw<Scalar>;

  // A forward and an inverse plan for buffers of one alignment.
  struct Pair {
    typename Api::Plan forward = nullptr, inverse = nullptr;
  };
  Pair aligned, unaligned;

  Plans(int rows, int cols, int channels) {
    const std::ptrdiff_t pixels = std::ptrdiff_t{rows} * cols, bins = std::ptrdiff_t{rows} * (cols / 2 + 1);
    if (pixels > std::numeric_limits<int>::max()) throw std::invalid_argument("RealFft2: too large for FFTW");
    // Planning needs buffers, though FFTW_ESTIMATE does not touch them.
    const std::unique_ptr<void, decltype(Api::deallocate)> image(
        Api::allocate(static_cast<std::size_t>(pixels * channels) * sizeof(Scalar)), Api::deallocate);
    const std::unique_ptr<void, decltype(Api::deallocate)> spectrum(
        Api::allocate(static_cast<std::size_t>(bins * channels) * 2 * sizeof(Scalar)), Api::deallocate);
    if (!image || !spectrum) throw std::bad_alloc();
    auto* const real = static_cast<Scalar*>(image.get());
    auto* const complex = static_cast<typename Api::Complex*>(spectrum.get());
    const std::array<int, 2> size = {rows, cols};

    const WisdomSetAside<Scalar> without_wisdom;
    const auto plan = [&](unsigned flags) {
      return Pair{
          Api::plan_r2c(2, size.data(), channels, real, nullptr, 1, static_cast<int>(pixels), complex,
                        nullptr, 1, static_cast<int>(bins), FFTW_ESTIMATE | flags),
          Api::plan_c2r(2, size.data(), channels, complex, nullptr, 1, static_cast<int>(bins), real, nullptr,
                        1, static_cast<int>(pixels), FFTW_ESTIMATE | FFTW_DESTROY_INPUT | flags)};
    };
    aligned = plan(0);
    unaligned = plan(FFTW_UNALIGNED);
    if (!aligned.forward || !aligned.inverse || !unaligned.forward || !unaligned.inverse) {
      destroy();
      throw std::runtime_error("RealFft2: FFTW cannot plan " + std::to_string(channels) + " x " +
                               std::to_string(rows) + " x " + std::to_string(cols));
    }
  }
  ~Plans() {
    const std::lock_guard lock(planner_mutex());
    destroy();
  }
  Plans(const Plans&) = delete;
  Plans& operator=(const Plans&) = delete;

  void destroy() {
    for (const auto plan : {aligned.forward, aligned.inverse, unaligned.forward, unaligned.inverse}) {
      if (plan != nullptr) Api::destroy(plan);
    }
  }

  // The plans that suit both buffers: those made for FFTW's own alignment, or the slower ones for any.
  const Pair& pair_for(const Scalar* image, const std::complex<Scalar>* spectrum) const {
    const auto alignment = [](const void* p) {
      return Api::alignment_of(static_cast<Scalar*>(const_cast<void*>(p)));
    };
    return alignment(image) == 0 && alignment(spectrum) == 0 ? aligned : unaligned;
  }

  // Parts of equal size share plans: one live set a size and precision.
  static std::shared_ptr<const Plans> shared(int rows, int cols, int channels) {
    static std::map<std::tuple<int, int, int>, std::weak_ptr<const Plans>> cache;
    const std::tuple key(rows, cols, channels);
    const std::lock_guard lock(planner_mutex());
    if (auto plans = cache[key].lock()) return plans;
    auto plans = std::make_shared<const Plans>(rows, cols, channels);
    std::erase_if(cache, [](const auto& entry) { return entry.second.expired(); });
    cache[key] = plans;
    return plans;
  }
};

template <typename Scalar>
RealFft2<Scalar>::RealFft2(int rows, int cols, int channels) : rows_(rows), cols_(cols), channels_(channels) {
  if (rows < 1 || cols < 1 || channels < 1) {
    throw std::invalid_argument("RealFft2: rows, cols and channels must be > 0, are " + std::to_string(rows) +
                                ", " + std::to_string(cols) + ", " + std::to_string(channels));
  }
  plans_ = Plans::shared(rows, cols, channels);
}

template <typename Scalar>
void RealFft2<Scalar>::forward(const Scalar* image, std::complex<Scalar>* spectrum) const {
  // An out-of-place r2c plan does not write its input; std::complex is layout-compatible with FFTW's.
  Fftw<Scalar>::execute_r2c(plans_->pair_for(image, spectrum).forward, const_cast<Scalar*>(image),
                            reinterpret_cast<typename Fftw<Scalar>::Complex*>(spectrum));
}

template <typename Scalar>
void RealFft2<Scalar>::inverse(std::complex<Scalar>* spectrum, Scalar* image) const {
  Fftw<Scalar>::execute_c2r(plans_->pair_for(image, spectrum).inverse,
                            reinterpret_cast<typename Fftw<Scalar>::Complex*>(spectrum), image);
  const std::ptrdiff_t pixels = std::ptrdiff_t{rows_} * cols_;
  const Scalar scale = 1 / static_cast<Scalar>(pixels);
  for (std::ptrdiff_t i = 0; i < pixels * channels_; ++i) image[i] *= scale;
}

template class RealFft2<float>;
template class RealFft2<double>;

}  // namespace asterism::inline ASTERISM_ABI
