// Plugins that must be refused; a macro REFUSED_... selects which. The constructors of those that are not for
// this program must not run.
#include <asterism/parts/concept/part_plugin.hpp>
#include <cstdlib>
#include <stdexcept>

#define EXPORTED extern "C" __attribute__((visibility("default")))
#define SECTION EXPORTED __attribute__((section(".asterism_part_plugin")))

namespace {

struct Trap {
  Trap() { std::abort(); }
};

struct NoOptions {};
[[maybe_unused]] void visit_options(asterism::OptionVisitor&, NoOptions&) {}

struct Nothing {
  explicit Nothing(const NoOptions&) {}
  void init(const asterism::Frame&, const asterism::Point2&, const asterism::Size2&) {}
  asterism::Evidence localize(const asterism::Frame&, const asterism::Point2&) { return {}; }
  double similarity_at(const asterism::Point2&) const { return 0; }
  void adapt(const asterism::Frame&, const asterism::Point2&) {}
};
static_assert(asterism::PartModel<Nothing>);

}  // namespace

#if defined(REFUSED_FOREIGN)  // built for another version
const Trap trap;
SECTION const char asterism_part_plugin_abi[];
const char asterism_part_plugin_abi[] = "Asterism v0_0_align16, Eigen 3.4, OpenCV 4.6, C++ ABI 1017";
EXPORTED void asterism_part_plugin_add(void*) { std::abort(); }

#elif defined(REFUSED_EMPTY)  // unrelated to parts
const Trap trap;
EXPORTED int answer() { return 42; }

#elif defined( \
    REFUSED_OLD)  // says what it was built for by a function, which cannot be called without loading
const Trap trap;
EXPORTED const char* asterism_part_plugin_abi() { return nullptr; }
EXPORTED void asterism_part_plugin_add(void*) { std::abort(); }

#elif defined(REFUSED_GARBLED)  // not terminated, and not printable
const Trap trap;
SECTION const unsigned char asterism_part_plugin_abi[];
const unsigned char asterism_part_plugin_abi[] = {'A', '\n', 0xff, 0x1b, '[', '2', 'J'};
EXPORTED void asterism_part_plugin_add(void*) { std::abort(); }

#elif defined(REFUSED_WITHOUT_ADD)
SECTION const char asterism_part_plugin_abi[];
const char asterism_part_plugin_abi[] = ASTERISM_PART_PLUGIN_ABI;

#elif defined(REFUSED_THROWS)
ASTERISM_PART_PLUGIN(models) {
  models.add<Nothing, NoOptions>("nothing");
  throw std::length_error("no GPU");
}

#elif defined(REFUSED_THROWS_INT)
ASTERISM_PART_PLUGIN(models) {
  models.add<Nothing, NoOptions>("nothing");
  throw 42;
}

#elif defined(REFUSED_NAME)
ASTERISM_PART_PLUGIN(models) { models.add<Nothing, NoOptions>("a:b"); }

#elif defined(REFUSED_TWICE)
ASTERISM_PART_PLUGIN(models) {
  models.add<Nothing, NoOptions>("nothing");
  models.add<Nothing, NoOptions>("nothing");
}
#endif
