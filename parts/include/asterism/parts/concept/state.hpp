#pragma once

#include <Eigen/Core>
#include <asterism/parts/concept/frame.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// What a model or a tracker has learned, on its way to bytes or back. One function of the model names its
/// members in a fixed order and serves both directions:
///
///     void visit_state(StateArchive& archive) {
///       archive.begin("my_model", options_);
///       archive(weight_);
///     }
///
/// What follows from options and sizes is not in it but made anew where `loading()`.
///
/// The bytes are numbers, never code. They begin with a mark, the version of the format, the byte order, the
/// length and a checksum (CRC-32), which are checked before anything is read. Whatever they hold, reading
/// them ends in an exception or in a state: each read is bounded, sizes are the reader's own, and numbers
/// must be finite and in the range that is asked for.
class ASTERISM_API StateArchive {
 public:
  /// Of the format.
  static constexpr std::uint32_t kVersion = 1;

  /// To be written to.
  StateArchive() = default;
  /// To be read from; `bytes` must outlive it. Throws std::runtime_error for bytes that are no state, cut
  /// short, damaged, or of another version or byte order.
  explicit StateArchive(std::span<const std::byte> bytes);

  /// Whether the state is being read.
  bool loading() const { return loading_; }

  /// The model that comes now, and its options (by their visit_options), which do not change: reading, the
  /// state must be of the same, or std::invalid_argument names what differs. Part models among the options
  /// are left to their own visit_state.
  template <typename Options>
  void begin(std::string_view model, Options options) {
    name(model);
    OptionCheck check(*this);
    visit_options(check, options);
    name("");
  }

  /// Writes a value, or reads it.
  void operator()(bool& value);
  void operator()(int& value);
  void operator()(float& value);
  void operator()(double& value);
  /// Matrices, arrays and blocks of them, of the size that they have.
  template <typename Derived>
  void operator()(Eigen::DenseBase<Derived>& values) {
    for (Eigen::Index col = 0; col < values.cols(); ++col)
      for (Eigen::Index row = 0; row < values.rows(); ++row) (*this)(values.derived().coeffRef(row, col));
  }
  template <typename Derived>
  void operator()(Eigen::DenseBase<Derived>&& values) {
    (*this)(values);
  }
  /// Complex numbers.
  template <typename T>
  void operator()(std::complex<T>& value) {
    T real = value.real(), imaginary = value.imag();
    (*this)(real), (*this)(imaginary);
    value = {real, imaginary};
  }
  /// An enumeration whose values are 0 .. count - 1.
  template <typename E>
  requires std::is_enum_v<E>
  void operator()(E& value, int count) {
    int index = static_cast<int>(value);
    (*this)(index);
    require(index >= 0 && index < count);
    value = static_cast<E>(index);
  }
  /// A position in the image, at most 1e6 px from its origin on each axis, and a size from 1e-6 to 1e6 px.
  void position(Point2& value);
  void size(Size2& value);
  /// How many things follow, which take at least `bytes_each` bytes each: reading, no more than are there.
  void count(int& value, std::size_t bytes_each);
  /// 8-bit pixels; the image has this size and number of channels already, or gets them.
  void pixels(cv::Mat& image, const cv::Size& size, int channels);

  /// Refuses a state with numbers that do not hold together: throws std::runtime_error.
  void require(bool holds) const;

  /// The bytes that were written.
  std::vector<std::byte> bytes() const;
  /// Reading: throws std::runtime_error where bytes are left.
  void finish() const { require(position_ == payload_.size()); }

 private:
  class OptionCheck final : public OptionVisitor {
   public:
    explicit OptionCheck(StateArchive& archive) : archive_(archive) {}
    using OptionVisitor::operator();
    void operator()(std::string_view name, double& value, const OptionRange&) override { check(name, value); }
    void operator()(std::string_view name, int& value, const OptionRange&) override { check(name, value); }
    void operator()(std::string_view name, bool& value) override { check(name, value); }
    void operator()(std::string_view name, std::uint64_t& value) override {
      check(name, static_cast<double>(value));
    }

   private:
    void made_by_name(std::string_view name, MemberReference member, std::string_view made) override;
    std::size_t choose(std::string_view name, std::size_t value,
                       std::initializer_list<std::string_view>) override {
      check(name, static_cast<double>(value));
      return value;
    }
    void enter(std::string_view name) override { archive_.name(name); }
    void check(std::string_view name, double value);

    StateArchive& archive_;
  };

  // The same in state and reader.
  void name(std::string_view what);
  void raw(void* data, std::size_t size);
  std::string text();

  bool loading_ = false;
  std::span<const std::byte> payload_;
  std::size_t position_ = 0;
  std::vector<std::byte> written_;
};

/// What can be saved: a model or tracker with `visit_state(StateArchive&)`, to which it gives what it has
/// learned, or from which it takes it, as if `init` and all that followed had been called. An exception may
/// leave it half read; restore_state works on a copy.
template <class T>
concept Stateful = std::copyable<T> && requires(T object, StateArchive& archive) {
  object.visit_state(archive);
};

/// The state as bytes, for a file. Throws std::logic_error before `init`, std::invalid_argument where a part
/// of it is not Stateful, and std::runtime_error where a number is out of the archive's range.
template <Stateful T>
std::vector<std::byte> save_state(const T& object) {
  StateArchive archive;
  T(object).visit_state(archive);
  return archive.bytes();
}

/// Takes over a state that `save_state` made of an object with the same options. Throws std::runtime_error
/// for bytes that are no state, damaged or cut short, std::invalid_argument for the state of something else;
/// the object is then as before.
template <Stateful T>
void restore_state(T& object, std::span<const std::byte> bytes) {
  StateArchive archive(bytes);
  T restored = object;
  restored.visit_state(archive);
  archive.finish();
  object = std::move(restored);
}

/// Throws std::invalid_argument: this kind of `what` cannot be saved.
[[noreturn]] ASTERISM_API void throw_not_stateful(std::string_view what);

}  // namespace ASTERISM_ABI
}  // namespace asterism
