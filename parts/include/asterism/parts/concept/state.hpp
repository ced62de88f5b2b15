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

/// Converts what a model or a tracker has learned to bytes, and back. One function of the model visits its
/// members in a fixed order and serves both directions:
///
///     void visit_state(StateArchive& archive) {
///       archive.begin("my_model", options_);
///       archive(weight_);
///     }
///
/// Values that follow from options and sizes are not saved; compute them again if `loading()`.
///
/// The bytes are numbers, never code. They begin with a mark, the version of the format, the byte order, the
/// length and a checksum (CRC-32), which are checked before anything is read. Whatever the bytes are, reading
/// them gives an exception or a valid state: each read is bounded, sizes are those of the reader, and numbers
/// must be finite and in the given range.
class ASTERISM_API StateArchive {
 public:
  /// The version of the format.
  static constexpr std::uint32_t kVersion = 1;

  /// An archive to write to.
  StateArchive() = default;
  /// An archive to read from; `bytes` must outlive it. Throws std::runtime_error for bytes that are not a
  /// state, that are truncated or damaged, or that have another version or byte order.
  explicit StateArchive(std::span<const std::byte> bytes);

  /// Whether the state is being read.
  bool loading() const { return loading_; }

  /// Begins a model with its options (by their visit_options), which do not change. When reading, the saved
  /// model and options must be the same; otherwise std::invalid_argument names the difference. Part models
  /// among the options have their own visit_state.
  template <typename Options>
  void begin(std::string_view model, Options options) {
    name(model);
    OptionCheck check(*this);
    visit_options(check, options);
    name("");
  }

  /// Writes or reads a value.
  void operator()(bool& value);
  void operator()(int& value);
  void operator()(float& value);
  void operator()(double& value);
  /// Writes or reads a matrix, an array or a block, of the size that it has.
  template <typename Derived>
  void operator()(Eigen::DenseBase<Derived>& values) {
    for (Eigen::Index col = 0; col < values.cols(); ++col)
      for (Eigen::Index row = 0; row < values.rows(); ++row) (*this)(values.derived().coeffRef(row, col));
  }
  template <typename Derived>
  void operator()(Eigen::DenseBase<Derived>&& values) {
    (*this)(values);
  }
  /// Writes or reads complex numbers.
  template <typename T>
  void operator()(std::complex<T>& value) {
    T real = value.real(), imaginary = value.imag();
    (*this)(real), (*this)(imaginary);
    value = {real, imaginary};
  }
  /// Writes or reads an enumeration whose values are 0 .. count - 1.
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
  /// Writes or reads a count of items, each of at least `bytes_each` bytes. Reading checks that they can
  /// exist.
  void count(int& value, std::size_t bytes_each);
  /// 8-bit pixels; the image has this size and number of channels already, or gets them.
  void pixels(cv::Mat& image, const cv::Size& size, int channels);

  /// For a state with inconsistent numbers: throws std::runtime_error.
  void require(bool holds) const;

  /// The written bytes.
  std::vector<std::byte> bytes() const;
  /// After reading: throws std::runtime_error if bytes are left.
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

/// A model or tracker that can be saved: `visit_state(StateArchive&)` writes what it has learned, or reads
/// it, as if `init` and all later functions had been called. After an exception it may be half read;
/// restore_state works on a copy.
template <class T>
concept Stateful = std::copyable<T> && requires(T object, StateArchive& archive) {
  object.visit_state(archive);
};

/// The state as bytes, for a file. Throws std::logic_error before `init`, std::invalid_argument if a part of
/// it is not Stateful, and std::runtime_error if a number is out of the archive's range.
template <Stateful T>
std::vector<std::byte> save_state(const T& object) {
  StateArchive archive;
  T(object).visit_state(archive);
  return archive.bytes();
}

/// Sets the state that `save_state` returned for an object with the same options. Throws std::runtime_error
/// for bytes that are not a state, damaged or truncated, and std::invalid_argument for the state of another
/// kind of object or of other options; the object is then unchanged.
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
