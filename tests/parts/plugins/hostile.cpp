// A plugin with a model that violates the contract, one that counts, and some that throw.
#include <asterism/parts/concept/part_plugin.hpp>
#include <limits>
#include <stdexcept>

namespace {

using namespace asterism;

struct HostileOptions {};
void visit_options(OptionVisitor&, HostileOptions&) {}

struct Hostile {
  explicit Hostile(const HostileOptions&) {}
  void init(const Frame&, const Point2&, const Size2& size) {
    if (size.minCoeff() <= 0) throw std::invalid_argument("a size");
  }
  Evidence localize(const Frame&, const Point2&) {
    return {.peak = std::numeric_limits<double>::quiet_NaN()};
  }
  double similarity_at(const Point2& position) const {
    if (position.x() < 0) return std::numeric_limits<double>::infinity();
    struct Mishap : std::exception {
      const char* what() const noexcept override { return "a mishap"; }
    };
    throw Mishap();
  }
  void adapt(const Frame&, const Point2&) { throw 42; }
};

struct Counter {
  int adapted = 0;
  explicit Counter(const HostileOptions&) {}
  void init(const Frame&, const Point2&, const Size2&) { adapted = 0; }
  Evidence localize(const Frame&, const Point2&) { return {.peak = static_cast<double>(adapted)}; }
  double similarity_at(const Point2&) const { return 0; }
  void adapt(const Frame&, const Point2&) { ++adapted; }
  void visit_state(StateArchive& archive) {
    archive.begin("counter", HostileOptions());
    archive(adapted);
  }
};

// Models that throw something other than a std::exception when they are constructed or copied.
struct ThrowingOptions {};
void visit_options(OptionVisitor&, ThrowingOptions&) { throw 42; }

struct OfThrowingOptions : Counter {
  explicit OfThrowingOptions(const ThrowingOptions&) : Counter(HostileOptions()) {}
};
struct ThrowingConstructor : Counter {
  explicit ThrowingConstructor(const HostileOptions& options) : Counter(options) { throw 42; }
};
struct ThrowingCopy : Counter {
  bool armed = false;
  explicit ThrowingCopy(const HostileOptions& options) : Counter(options) {}
  ThrowingCopy(const ThrowingCopy& other) : Counter(other), armed(other.armed) {
    if (armed) throw 42;
  }
  ThrowingCopy(ThrowingCopy&&) = default;
  ThrowingCopy& operator=(const ThrowingCopy&) = default;
  ThrowingCopy& operator=(ThrowingCopy&&) = default;
  ~ThrowingCopy() = default;
  void init(const Frame&, const Point2&, const Size2&) { armed = true; }
};

}  // namespace

ASTERISM_PART_PLUGIN(models) {
  models.add<OfThrowingOptions, ThrowingOptions>("options");
  models.add<ThrowingConstructor, HostileOptions>("constructor");
  models.add<ThrowingCopy, HostileOptions>("copy");
  models.add<Hostile, HostileOptions>("hostile");
  models.add<Counter, HostileOptions>("counter");
}
