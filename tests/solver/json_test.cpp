// Spring systems as JSON: every bit is restored, and every error names its place.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <asterism/solver/io/json.hpp>
#include <asterism/testing/random_system.hpp>
#include <bit>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

namespace asterism {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using namespace std::string_view_literals;
using Plane = SpringSystem<double, 2>;
template <int Dim>
using Anisotropic = SpringSystem<double, Dim, Eigen::Dynamic, Eigen::Dynamic,
                                 Model<Hooke, Quadratic, AnchorShape::Anisotropic>>;

template <typename A, typename B>
void expect_same_bits(const A& a, const B& b) {
  ASSERT_EQ(a.rows(), b.rows());
  ASSERT_EQ(a.cols(), b.cols());
  for (Eigen::Index i = 0; i < a.size(); ++i) {
    EXPECT_EQ(std::bit_cast<std::uint64_t>(a.reshaped()[i]), std::bit_cast<std::uint64_t>(b.reshaped()[i]))
        << a.reshaped()[i] << " and " << b.reshaped()[i];
  }
}

template <typename System>
void expect_same(const System& a, const System& b) {
  ASSERT_EQ(a.nodes(), b.nodes());
  ASSERT_TRUE(std::ranges::equal(a.links(), b.links()));
  expect_same_bits(a.anchors, b.anchors);
  expect_same_bits(a.anchor_stiffness, b.anchor_stiffness);
  expect_same_bits(a.rest_length, b.rest_length);
  expect_same_bits(a.link_stiffness, b.link_stiffness);
  expect_same_bits(a.rest_offset, b.rest_offset);
  expect_same_bits(a.loads, b.loads);
  if constexpr (System::kAnisotropic) expect_same_bits(a.anchor_shape, b.anchor_shape);
  EXPECT_EQ(a.fixed_count(), b.fixed_count());
  for (int i = 0; i < a.nodes(); ++i) EXPECT_EQ(a.is_fixed(i), b.is_fixed(i));
}

template <typename System>
class RoundTrip : public ::testing::Test {};
using Systems = ::testing::Types<Plane, Anisotropic<3>, SpringSystem<double, 2, Eigen::Dynamic, 16>,
                                 SpringSystem<double, 1>>;
TYPED_TEST_SUITE(RoundTrip, Systems);

TYPED_TEST(RoundTrip, KeepsEveryBit) {
  using System = TypeParam;
  constexpr int kDim = System::kDim;
  using Offsets = SpringSystem<double, kDim>;
  testing::Rng rng(7);
  std::stringstream file;
  std::vector<StoredSystem<System>> written;
  for (int n = 1; n <= 16; ++n) {
    const auto topology = n % 3 == 0 ? System::TopologyType::star(n, n / 2) : System::TopologyType::full(n);
    using Isotropic = SpringSystem<double, kDim, System::kNodes, System::kMaxNodes>;
    const auto [values, start] = testing::random_system<Isotropic>(rng, topology);
    System system(topology);
    system.anchors = values.anchors;
    system.anchor_stiffness = values.anchor_stiffness;
    system.rest_length = values.rest_length;
    system.link_stiffness = values.link_stiffness;
    if constexpr (System::kAnisotropic) {
      for (int i = 0; i < n; ++i) {
        const Eigen::Matrix<double, kDim, kDim> root = testing::random_points<System>(rng, kDim, -1, 1);
        system.set_anchor_information(i, root * root.transpose());
      }
    }
    if (n % 2 == 0) system.rest_offset = testing::random_points<Offsets>(rng, system.link_count(), -5, 5);
    if (n % 3 == 0) system.loads = testing::random_points<System>(rng, n, -5, 5);
    for (int i = n % 4; i < n; i += 3) system.fix(i);
    const json origin = {{"seed", 7}, {"n", n}, {"inner", {1.5, "x", nullptr, true}}};
    written.push_back({system, start, "system \"" + std::to_string(n) + "\"\n", origin.dump()});
    write_system(file, written.back());
  }
  const auto read = parse_systems<System>(file.str());
  ASSERT_EQ(read.size(), written.size());
  for (std::size_t i = 0; i < read.size(); ++i) {
    expect_same(read[i].system, written[i].system);
    expect_same_bits(read[i].start, written[i].start);
    EXPECT_EQ(read[i].name, written[i].name);
    EXPECT_EQ(read[i].origin, written[i].origin);
  }
}

TEST(Json, KeepsTheBitsOfExtremeNumbers) {
  using Limits = std::numeric_limits<double>;
  Plane system(Topology<>::full(4));
  system.anchors << -0.0, Limits::max(), Limits::denorm_min(), 1e-310, 0.1, -Limits::min(), 1.0 / 3, 1e22;
  system.anchor_stiffness << -0.0, 5e-324, 9007199254740993.0, 123456789012345678.0;
  system.rest_length.setConstant(std::nextafter(1.0, 2.0));
  system.link_stiffness.setConstant(Limits::epsilon());
  std::stringstream file;
  write_system(file, system, system.anchors);
  expect_same(parse_systems<Plane>(file.str()).at(0).system, system);
}

TEST(Json, KeepsLinksThatAreGivenTwice) {
  const std::vector<Link> links = {{1, 0}, {0, 1}, {1, 0}};
  Plane system(Topology<>::from_links(2, links));
  system.anchors.setZero();
  system.anchor_stiffness.setOnes();
  system.rest_length.setOnes();
  system.link_stiffness << 1, 2, 3;
  std::stringstream file;
  write_system(file, system, system.anchors);
  expect_same(parse_systems<Plane>(file.str()).at(0).system, system);
}

// The system of an object; its error is without the text's name and line.
template <typename System = Plane>
StoredSystem<System> system_from_json(const json& object) {
  const std::string place = "text:1: ";
  try {
    return parse_systems<System>(object.dump()).at(0);
  } catch (const std::runtime_error& error) {
    const std::string what = error.what();
    throw std::runtime_error(what.substr(what.starts_with(place) ? place.size() : 0));
  }
}

// Two linked nodes in the plane.
json pair() {
  return {{"asterism_system", 1},           {"dim", 2},
          {"anchors", {{0, 0}, {10, 1}}},   {"anchor_stiffness", {1, 0.5}},
          {"links", json::array({{0, 1}})}, {"rest_length", {8}},
          {"link_stiffness", {2}}};
}

json pair_in_space() {
  json object = pair();
  object["dim"] = 3;
  object["anchors"] = {{0, 0, 1}, {10, 1, 2}};
  return object;
}

TEST(Json, TakesDefaultsForWhatIsLeftOut) {
  const auto plain = system_from_json(pair());
  expect_same_bits(plain.start, plain.system.anchors);
  EXPECT_EQ(plain.name, "");
  EXPECT_EQ(plain.origin, "{}");
  EXPECT_EQ(plain.system.fixed_count(), 0);

  const auto shaped = system_from_json<Anisotropic<2>>(pair());
  expect_same_bits(shaped.system.anchor_shape, Eigen::Matrix<double, 2, 4>{{1, 0, 1, 0}, {0, 1, 0, 1}});
}

TEST(Json, ReadsOneSystemAnArrayAndJsonLines) {
  json named = pair();
  named["name"] = "second";
  const std::string one = pair().dump(), two = named.dump();
  EXPECT_EQ(parse_systems(one).size(), 1u);
  EXPECT_EQ(parse_systems(pair().dump(2)).size(), 1u);
  const std::vector<std::string> texts = {one + "\n" + two,
                                          one + "\r\n\r\n \t\n" + two + "\r\n",
                                          "\n\n" + one + "\n" + two + "\n",
                                          "[" + one + "," + two + "]",
                                          json::array({pair(), named}).dump(2),
                                          "[" + one + "]\n[" + two + "]",
                                          "\xEF\xBB\xBF" + one + "\n" + two};
  for (const std::string& text : texts) {
    SCOPED_TRACE(text);
    const auto systems = parse_systems<Plane>(text);
    ASSERT_EQ(systems.size(), 2u);
    EXPECT_EQ(systems[0].name, "");
    EXPECT_EQ(systems[1].name, "second");
  }
  for (const std::string text : {"", "\n", " \r\n\t\n", "[]", "[\n]\n"})
    EXPECT_TRUE(parse_systems(text).empty());
}

TEST(Json, ReadsPlaneAndSpaceFromOneFile) {
  const auto systems = parse_systems(pair().dump() + "\n" + pair_in_space().dump() + "\n");
  ASSERT_EQ(systems.size(), 2u);
  EXPECT_EQ(std::get<0>(systems[0]).start(0, 1), 10);
  EXPECT_EQ(std::get<1>(systems[1]).start(2, 1), 2);
}

// The message of the exception that `call` throws.
template <typename Call>
std::string error_of(Call&& call) {
  try {
    call();
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  return "(none)";
}

// The error for `pair` with `key` set to `value`.
std::string error_with(const char* key, const json& value) {
  json object = pair();
  object[key] = value;
  return error_of([&] { system_from_json(object); });
}

TEST(Json, NamesTheFieldThatIsWrong) {
  EXPECT_EQ(error_of([] { system_from_json(json(3)); }), "expected an object, found number");
  EXPECT_EQ(error_with("asterism_system", 2), "asterism_system is 2, known is version 1");
  EXPECT_EQ(error_with("asterism_system", 1.5), "asterism_system: expected an integer, found 1.5");
  EXPECT_EQ(error_with("asterism_system", "1"), "asterism_system: expected an integer, found string");
  EXPECT_EQ(error_with("dim", "2"), "dim: expected an integer, found string");
  EXPECT_EQ(error_with("dim", 0), "dim is 0");
  EXPECT_EQ(error_with("dim", 3), "dim is 3, expected 2");
  EXPECT_EQ(error_with("dim", 18446744073709551615u), "dim is 18446744073709551615");
  EXPECT_EQ(error_with("dim", 65), "dim is 65");

  EXPECT_EQ(error_with("anchors", nullptr), "anchors: expected an array, found null");
  EXPECT_EQ(error_with("anchors", {{0, 0}, 7}), "anchors[1]: expected an array, found number");
  EXPECT_EQ(error_with("anchors", {{0, 0}, {1, 2, 3}}), "anchors[1]: expected 2 (dim), found 3");
  EXPECT_EQ(error_with("anchors", {{0, 0}, {1, nullptr}}), "anchors[1][1]: expected a number, found null");
  EXPECT_EQ(error_with("anchors", {{0, "0"}, {1, 2}}), "anchors[0][1]: expected a number, found string");

  EXPECT_EQ(error_with("anchor_stiffness", {1, 2, 3}),
            "anchor_stiffness: expected 2 (one for each node), found 3");
  EXPECT_EQ(error_with("anchor_stiffness", {1, -2}), "anchor_stiffness[1] is negative");
  EXPECT_EQ(error_with("anchor_stiffness", {true, 2}),
            "anchor_stiffness[0]: expected a number, found boolean");
  EXPECT_EQ(error_with("rest_length", json::array()), "rest_length: expected 1 (one for each link), found 0");
  EXPECT_EQ(error_with("rest_length", {-1}), "rest_length[0] is negative");
  EXPECT_EQ(error_with("link_stiffness", {1, 2}), "link_stiffness: expected 1 (one for each link), found 2");
  EXPECT_EQ(error_with("link_stiffness", 1), "link_stiffness: expected an array, found number");

  const auto links = [](const json& second) { return error_with("links", json::array({{0, 1}, second})); };
  EXPECT_EQ(links({0, 2}), "links[1] has an end that is out of range");
  EXPECT_EQ(links({-1, 0}), "links[1] has an end that is out of range");
  EXPECT_EQ(links({4294967296, 0}), "links[1] has an end that is out of range");
  EXPECT_EQ(links({0, 18446744073709551615u}), "links[1] has an end that is out of range");
  EXPECT_EQ(links({-4294967296, 0}), "links[1] has an end that is out of range");
  EXPECT_EQ(links({1, 1}), "links[1] joins a node to itself");
  EXPECT_EQ(links({0, 1, 1}), "links[1]: expected 2 (nodes), found 3");
  EXPECT_EQ(links({0, 0.5}), "links[1][1]: expected a node's index, found 0.5");
  EXPECT_EQ(links({0, "1"}), "links[1][1]: expected a node's index, found string");
  EXPECT_EQ(links("01"), "links[1]: expected an array, found string");

  EXPECT_EQ(error_with("fixed", 1), "fixed: expected an array, found number");
  EXPECT_EQ(error_with("fixed", {0, 2}), "fixed[1] is out of range");
  EXPECT_EQ(error_with("fixed", {-1}), "fixed[0] is out of range");
  EXPECT_EQ(error_with("fixed", {false}), "fixed[0]: expected a node's index, found boolean");
  EXPECT_EQ(error_with("start", nullptr), "start: expected an array, found null");
  EXPECT_EQ(error_with("start", json::array({{0, 0}})), "start: expected 2 (one for each node), found 1");
  EXPECT_EQ(error_with("start", {{0, 0}, {0}}), "start[1]: expected 2 (dim), found 1");
  EXPECT_EQ(error_with("name", 7), "name: expected a string, found number");
  EXPECT_EQ(error_with("origin", "here"), "origin: expected an object, found string");
  EXPECT_EQ(error_with("anchor_shape", json::array()),
            "anchor_shape: a system with anisotropic anchors, which was not asked for");

  json empty = pair();
  for (const char* key : {"anchors", "anchor_stiffness", "links", "rest_length", "link_stiffness"})
    empty[key] = json::array();
  EXPECT_EQ(error_of([&] { system_from_json(empty); }), "system has no nodes");
}

// JSON Schema's integers.
TEST(Json, ReadsIntegersThatAreWrittenAsFloats) {
  const std::string text =
      R"({"asterism_system": 1.0, "dim": 20e-1, "anchors": [[0, 0], [3, 4]], "anchor_stiffness": [1, 1],)"
      R"( "links": [[0.0, 1e0]], "rest_length": [5], "link_stiffness": [1], "fixed": [1.0, -0.0]})";
  const auto systems = parse_systems(text);
  ASSERT_EQ(systems.size(), 1u);
  const auto& system = std::get<0>(systems[0]).system;
  EXPECT_EQ(system.nodes(), 2);
  EXPECT_EQ(system.links()[0].i, 0);
  EXPECT_EQ(system.links()[0].j, 1);
  EXPECT_TRUE(system.is_fixed(0) && system.is_fixed(1));
  for (const double large : {1e30, -1e30}) {
    EXPECT_EQ(error_with("fixed", {large}), "fixed[0] is out of range");
    EXPECT_NE(error_with("dim", large), "(none)");
    EXPECT_NE(error_with("asterism_system", large), "(none)");
  }
}

// What a double, or an integer of 64 bits, would lose.
TEST(Json, RefusesNumbersThatWouldBecomeOthers) {
  const auto error = [](const std::string& number, const char* key) {
    const std::string what =
        error_of([&] { parse_systems("{\"" + (key + ("\":\n[" + number)) + "\n]}", "f"); });
    return what == "f: asterism_system is missing" ? "(none)" : what;  // the numbers were read
  };
  for (const char* key : {"start", "origin"}) {
    EXPECT_EQ(error("1e-400", key), "f:2: number underflow parsing '1e-400'");
    EXPECT_EQ(error("-0.0010e-999", key), "f:2: number underflow parsing '-0.0010e-999'");
    EXPECT_EQ(error("1e-324", key), "f:2: number underflow parsing '1e-324'");
    EXPECT_EQ(error("-1e309", key), "f:2: number overflow parsing '-1e309'");
    for (const char* good : {"0e-400", "-0.000", "0e999", "5e-324", "2.5e-324", "18446744073709551615",
                             "-9223372036854775808", "1.7976931348623157e308", "1e20"})
      EXPECT_EQ(error(good, key), "(none)") << good;
  }
  for (const char* number : {"18446744073709551616", "-9223372036854775809"}) {
    EXPECT_EQ(error(number, "origin"), "f:2: the origin's integer " + std::string(number) +
                                           " has more than 64 bits: give it as a string");
    EXPECT_EQ(error(number, "start"), "(none)");
  }
}

TEST(Json, NamesTheShapeThatIsWrong) {
  const auto error = [](const json& shapes) {
    json object = pair();
    object["anchor_shape"] = shapes;
    return error_of([&] { system_from_json<Anisotropic<2>>(object); });
  };
  const json unit = {{1, 0}, {0, 1}};
  EXPECT_EQ(error({unit, unit}), "(none)");
  EXPECT_EQ(error(json::array({unit})), "anchor_shape: expected 2 (one for each node), found 1");
  EXPECT_EQ(error({unit, {{1, 0}}}), "anchor_shape[1]: expected 2 (dim), found 1");
  EXPECT_EQ(error({unit, {{1, 0}, {0}}}), "anchor_shape[1][1]: expected 2 (dim), found 1");
  EXPECT_EQ(error({unit, {{1, 0}, {nullptr, 1}}}), "anchor_shape[1][1][0]: expected a number, found null");
  const std::string not_psd = "information matrix of anchor 1 is not symmetric and positive semi-definite";
  EXPECT_EQ(error({unit, {{1, 0.5}, {0, 1}}}), not_psd);
  EXPECT_EQ(error({unit, {{1, 0}, {0, -0.5}}}), not_psd);
}

TEST(Json, RefusesMoreNodesThanTheTypeHas) {
  json object = pair();
  const std::string error =
      error_of([&] { system_from_json<SpringSystem<double, 2, Eigen::Dynamic, 1>>(object); });
  EXPECT_EQ(error, "node count 2 does not fit the topology's type");
}

TEST(Json, MissesEachRequiredKey) {
  const json whole = pair();
  for (const auto& [key, value] : whole.items()) {
    json object = whole;
    object.erase(key);
    EXPECT_EQ(error_of([&] { system_from_json(object); }), key + " is missing");
  }
}

TEST(Json, NamesTheNearestKeyToAnUnknownOne) {
  EXPECT_EQ(error_with("anchor_stifness", 1),
            "unknown key \"anchor_stifness\" (the nearest known one is \"anchor_stiffness\")");
  EXPECT_EQ(error_with("link", 1), "unknown key \"link\" (the nearest known one is \"links\")");
  EXPECT_EQ(error_with("Start", 1), "unknown key \"Start\" (the nearest known one is \"start\")");
  EXPECT_EQ(error_with("rest_lengths", 1),
            "unknown key \"rest_lengths\" (the nearest known one is \"rest_length\")");
  EXPECT_EQ(error_with("dimension", 1), "unknown key \"dimension\" (the nearest known one is \"dim\")");
  EXPECT_LT(error_with(std::string(100000, 'x').c_str(), 1).size(), 200u);
}

TEST(Json, NamesSourceLineAndSystem) {
  const auto error = [](const std::string& text) {
    return error_of([&] { parse_systems<Plane>(text, "f"); });
  };
  const std::string good = pair().dump();
  json object = pair();
  object["links"][0][1] = 2;
  const std::string bad = object.dump(), reason = "links[0] has an end that is out of range";
  EXPECT_EQ(error(bad), "f:1: " + reason);
  EXPECT_EQ(error(object.dump(2)), "f: " + reason);
  EXPECT_EQ(error(good + "\n\n" + bad + "\n" + good), "f:3: " + reason);
  EXPECT_EQ(error("[" + good + "," + bad + "]"), "f:1: system 1: " + reason);
  EXPECT_EQ(error("[\n" + good + ",\n" + bad + "]"), "f: system 1: " + reason);
  EXPECT_EQ(error(good + "\n[" + good + "," + bad + "]"), "f:2: system 1: " + reason);
  EXPECT_EQ(error(good + "\n3"), "f:2: expected an object, found number");
  EXPECT_EQ(error("[[]]"), "f:1: system 0: expected an object, found array");
  EXPECT_EQ(error(good + "\n" + pair_in_space().dump()), "f:2: dim is 3, expected 2");

  object = pair();
  object["dim"] = 4;
  EXPECT_EQ(error_of([&] { parse_systems(object.dump(), "f"); }), "f:1: dim is 4, expected 2 or 3");

  // Input that is not JSON.
  using ::testing::HasSubstr;
  using ::testing::StartsWith;
  EXPECT_THAT(error(good + "\n" + good.substr(0, 40)), StartsWith("f:2: not JSON: "));
  EXPECT_THAT(error("{\n\"asterism_system\": 1,\n\"dim\" 2}"), StartsWith("f:3: not JSON: "));
  EXPECT_THAT(error("{\n\"asterism_system\": 1,\n\n"), StartsWith("f:4: not JSON: "));
  EXPECT_THAT(error("hello"), StartsWith("f:1: not JSON: "));
  EXPECT_THAT(error(good + "\n" + R"({"dim": NaN})"), StartsWith("f:2: not JSON: "));
  EXPECT_THAT(error(std::string("\0\0", 2)), StartsWith("f:1: not JSON: "));
  EXPECT_THAT(error("{\"\xff\": 1}"), StartsWith("f:1: not JSON: "));
  EXPECT_THAT(error(good + "\n" + R"({"dim": 1e999})"),
              ::testing::AllOf(StartsWith("f:2: "), HasSubstr("1e999")));
  EXPECT_EQ(error(good + "\n" + R"({"dim": 2, "dim": 2})"), "f:2: duplicate key \"dim\"");
  EXPECT_EQ(error(R"({"origin": {"a": {"x": 1}, "b": {"x": 1, "x": 2}}})"), "f:1: duplicate key \"x\"");
  EXPECT_EQ(error("{\n\"a\": 1,\n\"a\": 2}"), "f:3: duplicate key \"a\"");
  EXPECT_EQ(error("{\n\"a\": 1e999}"), "f:2: number overflow parsing '1e999'");
  EXPECT_EQ(error(R"({"asterism_system": 1, "fi\nxed": 0})"),
            "f:1: unknown key \"fi\\nxed\" (the nearest known one is \"fixed\")");
  EXPECT_LT(error("{\"" + std::string(100000, 'x')).size(), 300u);
  EXPECT_EQ(error(std::string(200000, '[')), error(std::string(200, '[')));
  EXPECT_EQ(error(std::string(101, '[') + std::string(101, ']')), "f:1: is nested more than 100 deep");
  EXPECT_EQ(error(std::string(100, '[') + std::string(100, ']')),
            "f:1: system 0: expected an object, found array");
}

TEST(Json, SurvivesGarbage) {
  // Mutations of a valid text: each is read, or refused with its source's name; systems that are read can be
  // solved.
  testing::Rng rng(11);
  json object = pair();
  object["fixed"] = {1};
  object["origin"] = {{"a", {1, 2}}};
  const std::string good = object.dump() + "\n" + pair_in_space().dump() + "\n";
  const std::string_view letters = "{}[]\",:0123456789.-+eEnultrfas \n\\\0\xff"sv;
  int read = 0, refused = 0;
  for (int round = 0; round < 20000; ++round) {
    std::string text = good;
    for (std::uint64_t change = 0; change <= rng() % 3; ++change) {
      const std::size_t at = rng() % text.size();
      const char letter = letters[rng() % letters.size()];
      switch (rng() % 4) {
        case 0:
          text[at] = letter;
          break;
        case 1:
          text.insert(at, 1, letter);
          break;
        case 2:
          text.erase(at, 1 + rng() % 8);
          break;
        default:
          text.resize(at + 1);
          break;
      }
      if (text.empty()) break;
    }
    try {
      for (const auto& any : parse_systems(text, "f")) {
        std::visit([](const auto& s) { ASSERT_FALSE(detail::validate_values(s.system, s.start)); }, any);
      }
      ++read;
    } catch (const std::runtime_error& e) {
      ++refused;
      ASSERT_TRUE(std::string_view(e.what()).starts_with("f:")) << e.what();
    }
  }
  EXPECT_GT(read, 100);
  EXPECT_GT(refused, 5000);
}

TEST(Json, WritesNothingThatCannotBeRead) {
  auto stored = system_from_json(pair());
  const auto error = [](const StoredSystem<>& system) {
    std::ostringstream file;
    std::string what = error_of([&] { write_system(file, system); });
    EXPECT_EQ(file.str().empty(), what != "(none)");
    return what;
  };
  EXPECT_EQ(error(stored), "(none)");
  const std::string prefix = "the system cannot be written: ";
  auto bad = stored;
  bad.system.anchors(1, 1) = std::nan("");
  EXPECT_EQ(error(bad), prefix + "anchor 1 is not finite");
  bad = stored;
  bad.system.rest_length[0] = HUGE_VAL;
  EXPECT_EQ(error(bad), prefix + "rest length 0 is negative or not finite");
  bad = stored;
  bad.start(0, 0) = -HUGE_VAL;
  EXPECT_EQ(error(bad), prefix + "x of node 0 is not finite");
  bad = stored;
  bad.start.resize(2, 1);
  EXPECT_EQ(error(bad), prefix + "x must have one column for each node");
  bad = stored;
  bad.system.fix(9);
  EXPECT_EQ(error(bad), prefix + "fixed node 9 is out of range");
  bad = stored;
  bad.name = "\xff";
  EXPECT_EQ(error(bad), prefix + "its name or origin is not UTF-8");
  bad = stored;
  bad.origin = "3";
  EXPECT_EQ(error(bad), prefix + "origin is not an object but number");
  bad = stored;
  bad.origin = R"({"energies": [1, nan]})";
  EXPECT_THAT(error(bad), ::testing::StartsWith(prefix + "origin:1: not JSON: "));
  bad = stored;
  for (int depth = 1; depth < 98; ++depth) bad.origin = "{\"in\":" + bad.origin + "}";
  EXPECT_EQ(error(bad), "(none)");
  std::stringstream text;
  write_system(text, bad.system, bad.start, bad.name, bad.origin);
  EXPECT_EQ(parse_systems<decltype(bad.system)>("[" + text.str() + "]").at(0).origin, bad.origin);
  bad.origin = "{\"in\":" + bad.origin + "}";
  EXPECT_EQ(error(bad), prefix + "origin is nested more than 98 deep");
  bad = stored;
  bad.system.anchor_stiffness.setZero();  // nothing holds it: reported by a solver
  EXPECT_EQ(error(bad), "(none)");
}

TEST(Json, ReadsFiles) {
  const fs::path path =
      fs::path(::testing::TempDir()) / ("asterism_json_" + std::to_string(getpid()) + ".jsonl");
  std::ofstream file(path);
  for (int i = 0; i < 1000; ++i) write_system(file, system_from_json(pair()));
  file.close();
  EXPECT_EQ(read_systems<Plane>(path).size(), 1000u);
  EXPECT_EQ(read_systems(path).size(), 1000u);
  std::ofstream(path, std::ios::app) << "{}\n";
  EXPECT_EQ(error_of([&] { read_systems(path); }), path.string() + ":1001: asterism_system is missing");
  std::ofstream(path, std::ios::trunc).close();
  EXPECT_TRUE(read_systems(path).empty());
  fs::remove(path);
  EXPECT_EQ(error_of([&] { read_systems(path); }),
            path.string() + ": cannot be read: No such file or directory");
  EXPECT_EQ(error_of([] { read_systems(fs::path(::testing::TempDir())); }),
            fs::path(::testing::TempDir()).string() + ": cannot be read: Is a directory");
}

// The blocks of docs/system-json.md: the example first, the schema last; between them are those of version 2.
std::vector<std::string> documented_blocks() {
  std::ifstream page(ASTERISM_DOCS "/system-json.md");
  const std::string text{std::istreambuf_iterator<char>(page), {}};
  std::vector<std::string> blocks;
  const std::string fence = "\n```json\n";
  for (std::size_t at = text.find(fence); at != std::string::npos; at = text.find(fence, at)) {
    at += fence.size();
    blocks.push_back(text.substr(at, text.find("\n```", at) - at));
  }
  return blocks;
}

TEST(Json, IsAsDocumented) {
  const std::vector<std::string> kKeys = {
      "asterism_system",  "name",         "origin", "dim",         "anchors",
      "anchor_stiffness", "anchor_shape", "links",  "rest_length", "link_stiffness",
      "rest_offset",      "loads",        "fixed",  "start"};
  const auto blocks = documented_blocks();
  ASSERT_EQ(blocks.size(), 4u);
  const auto systems = parse_systems<Plane>(blocks[0]);
  ASSERT_EQ(systems.size(), 1u);
  EXPECT_EQ(systems[0].name, "two minima");
  EXPECT_TRUE(systems[0].system.is_fixed(0));
  EXPECT_EQ(systems[0].start(1, 2), -9);
  EXPECT_FALSE(validate(systems[0].system, systems[0].start));

  const json schema = json::parse(blocks[3]), example = json::parse(blocks[0]);
  std::vector<std::string> properties;
  for (const auto& [key, value] : schema["properties"].items()) properties.push_back(key);
  EXPECT_THAT(properties, ::testing::UnorderedElementsAreArray(kKeys));
  for (const auto& [key, value] : example.items()) {
    json object = example;
    object.erase(key);
    const auto& required = schema["required"];
    const bool is_required = std::find(required.begin(), required.end(), key) != required.end();
    EXPECT_EQ(error_of([&] { system_from_json(object); }), is_required ? key + " is missing" : "(none)");
  }
}

}  // namespace
}  // namespace asterism
