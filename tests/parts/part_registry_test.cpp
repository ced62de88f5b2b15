#include <elf.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <link.h>

#include <asterism/parts/concept/part_registry.hpp>
#include <asterism/parts/models/kcf.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace asterism {
namespace {

using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::StartsWith;

// The message of the Error that `f` throws.
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
  EXPECT_THAT(registry.names(),
              AllOf(Contains("kcf"), Contains("mosse"), Contains("strcf"), Contains("template")));
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
  options.window.padding = 1;
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
  EXPECT_EQ(refused("mose"), "unknown part model 'mose', did you mean 'mosse'?");
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
  EXPECT_THAT(refused(R"(kcf{"lambda": })"), StartsWith("kcf: its options are not a JSON object: "));
  EXPECT_THAT(refused(R"(kcf{"lambda": 1} x)"), StartsWith("kcf: its options are not a JSON object: "));
  EXPECT_THAT(refused(R"(kcf{"lambda": 1e999})"), StartsWith("kcf: its options are not a JSON object: "));
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
            "mute: unknown option 'a': it has no options");
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
              StartsWith("unknown part model '" + library + ":grey_patch" + nearest));
  EXPECT_THAT(refused(library), HasSubstr("is a plugin: give one of its models, " + library + ":gray_patch"));
  EXPECT_THAT(refused(library + R"(:gray_patch{"nose": 1})"),
              HasSubstr("unknown option 'nose', did you mean 'noise'?"));
  EXPECT_THAT(refused(library + R"(:gray_patch{"noise": 0})"),
              HasSubstr("gray_patch: GrayPatch: noise must be in [0.001, 1000], is 0"));
}

// Every known way in which a file is not a valid plugin for this program. The constructors in plugins for
// another program end the process, so they must not be run.
TEST(PartPlugin, IsRefusedInOneLineThatSaysWhy) {
  struct Case {
    const char *library, *part;
  };
  const Case cases[] = {
      {ASTERISM_FOREIGN_PLUGIN, " was built for Asterism v0_0_align16, "},
      {ASTERISM_FOREIGN_PLUGIN, ", this program for Asterism v"},
      {ASTERISM_EMPTY_PLUGIN, " is not a library of part models: it has no section .asterism_part_plugin, "},
      {ASTERISM_OLD_PLUGIN, " is not a library of part models: it has no section .asterism_part_plugin, "},
      {ASTERISM_GARBLED_PLUGIN, " was built for A???[2J, this program for "},
      {ASTERISM_WITHOUT_ADD_PLUGIN, " is not a library of part models: it has no asterism_part_plugin_add"},
      {ASTERISM_THROWS_PLUGIN, ": no GPU"},
      {ASTERISM_THROWS_INT_PLUGIN, ": an exception that is not a std::exception"},
      {ASTERISM_NAME_PLUGIN, "a part model's name must consist of letters"},
      {ASTERISM_TWICE_PLUGIN, "there is a part model 'nothing' already"},
      {"/proc/self/exe", "it has no section"},
      {"/dev/zero", " is not a library of part models: it is not a regular file"},
      {"/", " is not a library of part models: it is not a regular file"},
  };
  for (const auto& [library, part] : cases) {
    PartRegistry registry;
    const std::vector<std::string> before = registry.names();
    const std::string text = message<std::runtime_error>([&, library = library] { registry.load(library); });
    EXPECT_THAT(text, HasSubstr(part));
    EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    EXPECT_EQ(registry.names(), before) << library;
  }
}

// A truncated plugin, or one with a damaged section table, made from one that would end the process if
// loaded.
TEST(PartPlugin, IsRefusedWhereItsFileIsDamaged) {
  std::ifstream file(ASTERISM_FOREIGN_PLUGIN, std::ios::binary);
  const std::string whole{std::istreambuf_iterator<char>(file), {}};
  ElfW(Ehdr) header;
  ASSERT_GT(whole.size(), sizeof header);
  std::memcpy(&header, whole.data(), sizeof header);
  const std::string path = ::testing::TempDir() + "damaged_plugin.so";
  const auto expect_refused = [&](const std::string& bytes) {
    std::ofstream(path, std::ios::binary) << bytes;
    EXPECT_THAT(not_loaded(path), AnyOf(HasSubstr("it has no section"), HasSubstr("was built for")));
  };
  for (std::size_t size = 0; size < whole.size(); size += 1 + size / 16)
    expect_refused(whole.substr(0, size));
  const auto with = [&](std::size_t at, std::uint64_t value, std::size_t bytes) {
    std::string damaged = whole;
    std::memcpy(damaged.data() + at, &value, bytes);
    return damaged;
  };
  const std::size_t sections = header.e_shoff;
  for (const std::uint64_t value :
       {std::uint64_t{0}, std::uint64_t{1}, ~std::uint64_t{0}, ~std::uint64_t{0} / 2}) {
    expect_refused(with(offsetof(ElfW(Ehdr), e_shoff), value, sizeof header.e_shoff));
    expect_refused(with(offsetof(ElfW(Ehdr), e_shnum), value, sizeof header.e_shnum));
    expect_refused(with(offsetof(ElfW(Ehdr), e_shstrndx), value, sizeof header.e_shstrndx));
    expect_refused(with(EI_CLASS, value, 1));
    for (int i = 0; i < header.e_shnum; ++i) {
      const std::size_t at = sections + static_cast<std::size_t>(i) * sizeof(ElfW(Shdr));
      expect_refused(with(at + offsetof(ElfW(Shdr), sh_name), value, 4));
      expect_refused(with(at + offsetof(ElfW(Shdr), sh_offset), value, sizeof(ElfW(Shdr)::sh_offset)));
      expect_refused(with(at + offsetof(ElfW(Shdr), sh_size), value, sizeof(ElfW(Shdr)::sh_size)));
    }
  }
  std::filesystem::remove(path);
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
            library + ":hostile: an exception that is not a std::exception");
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

TEST(PartPlugin, ThrowsWithItsNameBeforeItIsAPart) {
  const std::string library = ASTERISM_HOSTILE_PLUGIN, reason = ": an exception that is not a std::exception";
  PartRegistry registry;
  for (const std::string model : {":options", ":constructor"})
    EXPECT_EQ(message<std::runtime_error>([&] { registry.make(library + model); }), library + model + reason);
  EXPECT_EQ(message<std::runtime_error>([&] { registry.defaults(library + ":options"); }),
            library + ":options" + reason);
  EXPECT_THAT(message<std::invalid_argument>([&] { registry.make(library + R"(:copy{"a": 1})"); }),
              StartsWith(library + ":copy: unknown option 'a'"));
  const cv::Mat image = testing::texture(60, 80);
  AnyPart part = registry.make(library + ":copy");
  part.init(Frame(image), {40, 30}, {20, 20});
  EXPECT_EQ(message<std::runtime_error>([&] { const AnyPart copy = part; }), library + ":copy" + reason);
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
