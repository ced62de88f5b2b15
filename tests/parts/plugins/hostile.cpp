// A part model that does what none may.
#include <asterism/parts/part_plugin.hpp>
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

}  // namespace

ASTERISM_PART_PLUGIN(models) { models.add<Hostile, HostileOptions>("hostile"); }
