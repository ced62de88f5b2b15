#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <asterism/parts/kcf.hpp>
#include <asterism/parts/part_registry.hpp>
#include <string>

#include "part_axioms.hpp"

namespace asterism {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::StartsWith;

// What `f` says when it throws an Error.
template <typename Error, typename F>
std::string message(F&& f) {
  try {
    f();
  } catch (const Error& error) {
    return error.what();
  }
  return "nothing of this kind was thrown";
}

std::string refused(const std::string& model) {
  return message<std::invalid_argument>([&] { PartRegistry().make(model); });
}
std::string not_loaded(const std::string& library) {
  return message<std::runtime_error>([&] { PartRegistry().load(library); });
}

TEST(PartRegistry, MakesEveryModelWithItsDefaults) {
  PartRegistry registry;
  EXPECT_THAT(registry.names(), AllOf(Contains("kcf"), Contains("mosse"), Contains("template")));
  const cv::Mat image = testing::texture(120, 160);
  const Frame frame(image);
  for (const std::string& name : registry.names()) {
    SCOPED_TRACE(name);
    AnyPart plain = registry.make(name), listed = registry.make(name + registry.defaults(name));
    for (AnyPart* part : {&plain, &listed}) part->init(frame, {80, 60}, {40, 30});
    const Evidence expected = plain.localize(frame, {83, 58}), evidence = listed.localize(frame, {83, 58});
    EXPECT_EQ(evidence.position, expected.position);
    EXPECT_EQ(evidence.covariance, expected.covariance);
  }
}

TEST(PartRegistry, SetsOptions) {
  KcfOptions options;
  options.kernel.type = Kernel::Type::Linear;
  options.padding = 1;
  options.sub_pixel = false;
  options.cell_size = 2;
  Kcf expected(options);
  AnyPart part = PartRegistry().make(
      R"(kcf {"kernel": {"type": "linear"}, "padding": 1, "sub_pixel": false, "cell_size": 2})");
  const cv::Mat image = testing::texture(120, 160);
  const Frame frame(image);
  expected.init(frame, {80, 60}, {40, 30});
  part.init(frame, {80, 60}, {40, 30});
  EXPECT_EQ(part.localize(frame, {83, 58}).covariance, expected.localize(frame, {83, 58}).covariance);
}

TEST(PartRegistry, SaysWhatIsWrong) {
  EXPECT_EQ(refused("mose"), "no part model 'mose', did you mean 'mosse'?");
  EXPECT_EQ(refused(R"(kcf{"lamda": 1})"), "kcf: unknown option 'lamda', did you mean 'lambda'?");
  EXPECT_EQ(refused(R"(kcf{"kernel": {"sigmas": 1}})"),
            "kcf: unknown option 'kernel.sigmas', did you mean 'kernel.sigma'?");
  EXPECT_EQ(refused(R"(kcf{"lambda": "1"})"), "kcf: option 'lambda' must be a number, not \"1\"");
  EXPECT_EQ(refused(R"(kcf{"cell_size": 4.5})"), "kcf: option 'cell_size' must be an integer, not 4.5");
  EXPECT_EQ(refused(R"(kcf{"cell_size": 40000000000})"),
            "kcf: option 'cell_size' must be an integer, not 40000000000");
  EXPECT_EQ(refused(R"(kcf{"sub_pixel": 1})"), "kcf: option 'sub_pixel' must be true or false, not 1");
  EXPECT_EQ(refused(R"(kcf{"kernel": 1})"), "kcf: option 'kernel' must be an object, not 1");
  EXPECT_EQ(
      refused(R"(kcf{"kernel": {"type": "gauss"}})"),
      "kcf: option 'kernel.type' must be one of \"gaussian\", \"polynomial\", \"linear\", not \"gauss\"");
  EXPECT_THAT(refused(R"(kcf{"lambda": })"), StartsWith("kcf: its options are no JSON object: "));
  EXPECT_THAT(refused(R"(kcf{"lambda": 1} x)"), StartsWith("kcf: its options are no JSON object: "));
  EXPECT_THAT(refused(R"(kcf{"lambda": 1e999})"), StartsWith("kcf: its options are no JSON object: "));
  EXPECT_EQ(refused("kcf{\"lambda\": " + std::string(100000, '[')), "kcf: options nested more than 100 deep");
  EXPECT_THAT(refused(R"(kcf{"lambda": -1})"), AllOf(StartsWith("kcf: "), HasSubstr("lambda")));
  EXPECT_EQ(refused(""), refused("{}"));
}

struct Mute {
  struct Options {};
  explicit Mute(const Options&) {}
  void init(const Frame&, const Point2&, const Size2&) {}
  Evidence localize(const Frame&, const Point2&) { return {}; }
  double similarity_at(const Point2&) const { return 0; }
  void adapt(const Frame&, const Point2&) {}
};
void visit_options(OptionVisitor&, Mute::Options&) {}

TEST(PartRegistry, TakesModelsOfOnesOwn) {
  PartRegistry registry;
  registry.add<Mute, Mute::Options>("mute");
  EXPECT_THAT(registry.names(), Contains("mute"));
  EXPECT_EQ(registry.defaults("mute"), "{}");
  registry.make("mute");
  EXPECT_EQ(message<std::invalid_argument>([&] { registry.make(R"(mute{"a": 1})"); }),
            "mute: unknown option 'a', there are none");
  const auto add = [&](const char* name) {
    return message<std::invalid_argument>([&] { registry.add<Mute, Mute::Options>(name); });
  };
  EXPECT_EQ(add("kcf"), "there is a part model 'kcf' already");
  for (const char* name : {"", "a b", "a:b", "a{"}) EXPECT_THAT(add(name), StartsWith("a part model's name"));
}

// The example of docs/own-part.md.
TEST(PartPlugin, IsAPartLikeAnother) {
  PartRegistry registry;
  const std::string library = ASTERISM_EXAMPLE_PLUGIN;
  AnyPart part = registry.make(library + R"(:gray_patch{"noise": 12})");
  EXPECT_THAT(registry.names(), Contains(library + ":gray_patch"));
  EXPECT_EQ(registry.load(library), std::vector{library + ":gray_patch"});
  testing::check_part_axioms(part, 1);
  testing::check_part_faults(part);
  const std::string nearest = "', did you mean '" + library + ":gray_patch";
  EXPECT_THAT(refused(library + ":grey_patch"),
              StartsWith("no part model '" + library + ":grey_patch" + nearest));
  EXPECT_THAT(refused(library + R"(:gray_patch{"nose": 1})"),
              HasSubstr("unknown option 'nose', did you mean 'noise'?"));
  EXPECT_THAT(refused(library + R"(:gray_patch{"noise": 0})"),
              HasSubstr("gray_patch: noise must be positive"));
}

TEST(PartPlugin, IsRefusedForAnotherVersion) {
  EXPECT_THAT(not_loaded(ASTERISM_FOREIGN_PLUGIN), AllOf(HasSubstr("was built for Asterism v0_0_align16, "),
                                                         HasSubstr(", this program for Asterism v")));
}

TEST(PartPlugin, IsRefusedWithoutItsSymbols) {
  EXPECT_THAT(not_loaded(ASTERISM_EMPTY_PLUGIN),
              HasSubstr("is no library of part models: it has no symbol asterism_part_plugin_abi"));
}

TEST(PartPlugin, IsRefusedWhereThereIsNoLibrary) {
  EXPECT_THAT(not_loaded("/nonexistent.so"), AllOf(StartsWith("cannot load"), HasSubstr("/nonexistent.so")));
  EXPECT_THAT(message<std::runtime_error>([] { PartRegistry().make("nonexistent.so:model"); }),
              HasSubstr("nonexistent.so"));
}

TEST(PartPlugin, ThrowsWithItsName) {
  const std::string library = ASTERISM_HOSTILE_PLUGIN;
  PartRegistry registry;
  const cv::Mat image = testing::texture(60, 80);
  const Frame frame(image);
  AnyPart part = registry.make(library + ":hostile");
  part.init(frame, {40, 30}, {20, 20});
  EXPECT_EQ(message<std::runtime_error>([&] {
              part.localize(frame, {40, 30});
            }),
            library + ":hostile: evidence that is not finite");
  EXPECT_EQ(message<std::runtime_error>([&] {
              part.adapt(frame, {40, 30});
            }),
            library + ":hostile: an exception that is no std::exception");
  EXPECT_EQ(message<std::runtime_error>([&] {
              part.similarity_at({40, 30});
            }),
            library + ":hostile: a mishap");
  EXPECT_EQ(message<std::runtime_error>([&] {
              part.similarity_at({-1, 30});
            }),
            library + ":hostile: a similarity that is not finite");
  EXPECT_EQ(message<std::invalid_argument>([&] {
              part.init(frame, {40, 30}, {0, 0});
            }),
            library + ":hostile: a size");
}

TEST(PartPlugin, IsSavedIfItCanBe) {
  const std::string library = ASTERISM_HOSTILE_PLUGIN;
  PartRegistry registry;
  const cv::Mat image = testing::texture(60, 80);
  const Frame frame(image);
  AnyPart counter = registry.make(library + ":counter"), other = counter;
  EXPECT_TRUE(counter.stateful());
  for (int i = 0; i < 3; ++i) counter.adapt(frame, {40, 30});
  const std::vector<std::byte> state = save_state(counter);
  restore_state(other, state);
  EXPECT_EQ(other.localize(frame, {40, 30}).peak, 3);

  AnyPart hostile = registry.make(library + ":hostile");
  EXPECT_FALSE(hostile.stateful());
  const std::string reason = library + ":hostile: state: this kind of part model cannot be saved";
  EXPECT_EQ(message<std::invalid_argument>([&] { save_state(hostile); }), reason);
  EXPECT_EQ(message<std::invalid_argument>([&] { restore_state(hostile, state); }), reason);
  EXPECT_THAT(message<std::invalid_argument>([&] {
                AnyPart kcf = registry.make("kcf");
                restore_state(kcf, state);
              }),
              HasSubstr("'counter' where 'kcf' is"));
}

TEST(PartRegistry, EveryModelOfTheLibraryCanBeSaved) {
  PartRegistry registry;
  for (const std::string& name : registry.names()) EXPECT_TRUE(registry.make(name).stateful()) << name;
}

}  // namespace
}  // namespace asterism
