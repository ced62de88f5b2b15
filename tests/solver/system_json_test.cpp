// Systems of terms as JSON: every bit of every kind is restored, and every error names its place.

#include <gtest/gtest.h>
#include <unistd.h>

#include <asterism/solver/io/json.hpp>
#include <asterism/solver/terms/kinds.hpp>
#include <bit>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <random>
#include <sstream>
#include <string>

namespace asterism {
namespace {

constexpr std::string_view kKinds[] = {"anchors",  "links",  "offsets", "loads",        "differences",
                                       "bendings", "angles", "areas",   "common_length"};

void expect_same_bits(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  if (a.size() == 0 && b.size() == 0) return;
  ASSERT_EQ(a.rows(), b.rows());
  ASSERT_EQ(a.cols(), b.cols());
  for (Eigen::Index i = 0; i < a.size(); ++i)
    EXPECT_EQ(std::bit_cast<std::uint64_t>(a.data()[i]), std::bit_cast<std::uint64_t>(b.data()[i]));
}

void expect_same(const System& a, const System& b) {
  ASSERT_EQ(a.nodes(), b.nodes());
  ASSERT_EQ(a.dim(), b.dim());
  for (int i = 0; i < a.nodes(); ++i) EXPECT_EQ(a.is_fixed(i), b.is_fixed(i));
  ASSERT_EQ(a.term_count(), b.term_count());
  for (int t = 0; t < a.term_count(); ++t) {
    const Term &one = a.term(t), &other = b.term(t);
    ASSERT_EQ(one.kind(), other.kind());
    SCOPED_TRACE(std::string(one.kind()));
    ASSERT_EQ(one.size(), other.size());
    EXPECT_EQ(one.nodes(), other.nodes());
    for (std::size_t c = 0; c < one.columns().size(); ++c)
      expect_same_bits(one.columns()[c].values, other.columns()[c].values);
    for (std::size_t c = 0; c < one.choices().size(); ++c)
      EXPECT_EQ(one.choices()[c].value, other.choices()[c].value);
  }
}

// A term of a kind whose columns are drawn one by one: the same for all elements, one for each, or none.
std::unique_ptr<Term> random_term(std::string_view kind, int dim, int nodes, std::mt19937& random) {
  std::unique_ptr<Term> term = make_term(kind, dim);
  const int size = std::uniform_int_distribution<>(0, 4)(random);
  std::uniform_real_distribution<> value(0.1, 3);
  Eigen::MatrixXi of(term->arity(), size);
  for (int e = 0; e < size; ++e) {
    for (int a = 0; a < term->arity(); ++a) of(a, e) = (e + a * 2) % nodes;
  }
  term->set_nodes(of);
  for (const Column& column : term->columns()) {
    const bool is_chosen = column.name == "scale" || column.name == "sharpness" || column.name == "upper";
    if (column.is_optional && !is_chosen && random() % 2 == 0) continue;
    const bool is_one = random() % 2 == 0 || column.name.starts_with("prior");
    const int rows = column.other_rows > 0 && random() % 2 == 0 ? column.other_rows : column.rows;
    Eigen::MatrixXd values =
        Eigen::MatrixXd::NullaryExpr(rows, is_one ? 1 : size, [&] { return value(random); });
    if (column.name == "upper") values.array() += 3;
    for (Eigen::Index e = 0; column.name == "information" && e < values.cols(); ++e) {
      Eigen::Map<Eigen::MatrixXd> matrix(values.col(e).data(), dim, dim);
      matrix = (matrix * matrix.transpose()).eval();
    }
    if (column.range == Column::Range::Any && values.size() > 1 && column.name != "information")
      values(0, 0) = -0.0, values.data()[1] = std::numeric_limits<double>::denorm_min();
    term->values(column.name) = values;
  }
  for (const Choice& choice : term->choices()) {
    const bool is_law = choice.name == "law";
    const std::size_t count =
        kind == "common_length" ? 2 : choice.names().size() - (is_law ? 1 : 0);  // not "own"
    term->choose(choice.name, choice.names()[random() % count]);
  }
  return term;
}

TEST(SystemJson, KeepsEveryBitOfEveryKind) {
  std::mt19937 random(1);
  for (const int dim : {1, 2, 3, 5}) {
    std::stringstream file;
    std::vector<StoredTerms> written;
    for (int k = 0; k < 40; ++k) {
      System system(9, dim);
      for (const std::string_view kind : kKinds) system.add(random_term(kind, dim, 9, random));
      system.fix(k % 9);
      written.push_back({system, Eigen::MatrixXd::Random(dim, 9) / 3,
                         "system \"" + std::to_string(k) + "\"\n", R"({"k":[1.5,"x",null,true]})"});
      write_stored_terms(file, written.back());
    }
    const std::vector<StoredTerms> read = parse_stored_terms(file.str());
    ASSERT_EQ(read.size(), written.size());
    for (std::size_t i = 0; i < read.size(); ++i) {
      expect_same(read[i].system, written[i].system);
      expect_same_bits(read[i].start, written[i].start);
      EXPECT_EQ(read[i].name, written[i].name);
      EXPECT_EQ(read[i].origin, written[i].origin);
      EXPECT_EQ(to_json(read[i]), to_json(written[i]));
    }
  }
}

// Springs: 1/2 0.5 |x_1 - a_1|^2 and so on, by hand.
TEST(SystemJson, ReadsSpringsOfVersion1) {
  const auto systems = parse_stored_terms(
      R"({"asterism_system": 1, "name": "old", "dim": 2, "anchors": [[0, 0], [10, 1]], "anchor_stiffness": [2, 0.5],)"
      R"( "anchor_shape": [[[1, 0], [0, 1]], [[1, 0], [0, 0]]], "links": [[0, 1]], "rest_length": [5],)"
      R"( "link_stiffness": [2], "rest_offset": [[0, 1]], "loads": [[0, 0], [1, 2]], "fixed": [1]})");
  ASSERT_EQ(systems.size(), 1u);
  const StoredTerms& stored = systems[0];
  EXPECT_EQ(stored.name, "old");
  EXPECT_TRUE(stored.system.is_fixed(1));
  EXPECT_EQ(stored.start, (Eigen::MatrixXd{{0, 10}, {0, 1}}));
  const Eigen::MatrixXd x{{1, 4}, {2, 5}};
  // Anchors 2 (1 + 4) / 2 and 0.5 36 / 2; the link's vector is (-3, -3 - 1), of length 5; loads 4 + 10.
  EXPECT_DOUBLE_EQ(energy(stored.system, x), 5 + 9 + 0 - 14);
  const StoredTerms again = parse_stored_terms(to_json(stored)).at(0);
  expect_same(again.system, stored.system);
}

TEST(SystemJson, ReadsFiles) {
  const auto path =
      std::filesystem::temp_directory_path() / ("system_json_test_" + std::to_string(getpid()) + ".jsonl");
  System system(2, 2);
  system.add_anchors(Eigen::Matrix2d::Identity(), System::all(1));
  {
    std::ofstream file(path);
    write_stored_terms(file, {system, Eigen::Matrix2d::Identity(), {}, "{}"});
  }
  const auto read = read_stored_terms(path);
  std::filesystem::remove(path);
  ASSERT_EQ(read.size(), 1u);
  expect_same(read[0].system, system);
  EXPECT_THROW(read_stored_terms(path), std::runtime_error);
}

template <typename Call>
std::string error_of(Call&& call) {
  try {
    call();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "(none)";
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(SystemJson, NamesWhatIsWrong) {
  const std::string good =
      R"({"asterism_system": 2, "dim": 2, "nodes": 3, "start": [[0, 0], [1, 0], [2, 0]], "fixed": [0], "terms": [)"
      R"({"kind": "anchors", "nodes": [0, [1], 2], "position": [[0, 0], [1, 0], [2, 0]], "stiffness": 0.5},)"
      R"({"kind": "links", "nodes": [[0, 1], [1, 2]], "length": [1, 1.5], "stiffness": 1.0, "loss": "huber", "scale": 3},)"
      R"({"kind": "differences", "nodes": [[0, 1, 2]], "target": [0, 0], "stiffness": 1, "a": 1, "b": [[0, 1], [-1, 0]], "c": 1}]})";
  ASSERT_EQ(parse_stored_terms(good).size(), 1u);
  const struct {
    const char *from, *to, *error;
  } kCases[] = {
      {R"("asterism_system": 2)", R"("asterism_system": 3)",
       "asterism_system is 3, known are versions 1 and 2"},
      {R"("dim": 2)", R"("dim": 0)", "dim is 0, expected 1 to 64"},
      {R"("dim": 2)", R"("dim": 65)", "dim is 65, expected 1 to 64"},
      {R"("dim": 2, )", "", "dim is missing"},
      {R"("nodes": 3)", R"("nodes": -1)", "nodes is -1"},
      {R"("nodes": 3)", R"("nodes": 2000000000)", "start: expected 2000000000 (one for each node), found 3"},
      {R"("nodes": 3)", R"("nodes": 2.5)", "nodes: expected a node's index, found 2.5"},
      {R"("fixed": [0])", R"("fixed": [3])", "fixed[0] is out of range"},
      {R"("fixed": [0])", R"("fixd": [0])", "unknown key \"fixd\" (the nearest known one is \"fixed\")"},
      {R"("fixed": [0])", R"("fixed": [0], "fixed": [])", "duplicate key \"fixed\""},
      {R"([2, 0]], "fixed")", R"([2]], "fixed")", "start[2]: expected 2 (dim), found 1"},
      {R"("kind": "links")", R"("kind": "link")",
       "terms[1]: unknown kind of term 'link' (known: anchors links offsets loads differences bendings "
       "angles "
       "areas common_length)"},
      {R"("kind": "links")", R"("kind": 3)", "terms[1]: kind: expected a string, found number"},
      {R"({"kind": "links", )", "{", "terms[1]: kind is missing"},
      {R"("kind": "anchors")", R"("kind": "elements")", "terms[0]: unknown kind of term 'elements' (known: "},
      {R"([[0, 1], [1, 2]])", R"([[0, 1], [1, 3]])", "terms[1]: nodes[1][1] is out of range"},
      {R"([[0, 1], [1, 2]])", R"([[0, 1], [1, 1]])", "terms[1]: links: element 1 has one node twice"},
      {R"([[0, 1], [1, 2]])", R"([[0, 1], [1]])",
       "terms[1]: nodes[1]: expected 2 (nodes of an element), found 1"},
      {R"([[0, 1], [1, 2]])", R"([[0, 1], 1])", "terms[1]: nodes[1]: expected an array, found number"},
      {R"("length": [1, 1.5])", R"("length": [1])",
       "terms[1]: length: expected 2 (one for each element), found 1"},
      {R"("length": [1, 1.5])", R"("length": [1, null])",
       "terms[1]: length[1]: expected a number, found null"},
      {R"("length": [1, 1.5])", R"("length": [1, [2]])",
       "terms[1]: length[1]: expected a number, found array"},
      {R"("length": [1, 1.5])", R"("length": [1, -1.5])",
       "terms[1]: links: length of element 1 is negative or not finite: -1.5"},
      {R"("length": [1, 1.5])", R"("length": [1, 1e999])", "number overflow parsing '1e999'"},
      {R"("length": [1, 1.5])", R"("length": [1, 1e-400])", "number underflow parsing '1e-400'"},
      {R"("length": [1, 1.5], )", "", "terms[1]: length is missing"},
      {R"("length")", R"("lenght")",
       "terms[1]: unknown key \"lenght\" (the nearest known one is \"length\")"},
      {R"("loss": "huber")", R"("loss": "hubr")",
       "terms[1]: links: unknown loss 'hubr', did you mean 'huber'?"},
      {R"("loss": "huber")", R"("loss": 1)", "terms[1]: loss: expected a string, found number"},
      {R"(, "scale": 3)", "", "terms[1]: links: the loss huber needs a scale"},
      {R"("loss": "huber")", R"("law": "own")",
       "terms[1]: links: the law own needs a function, and the user gave none"},
      {R"("position": [[0, 0], [1, 0], [2, 0]])", R"("position": 0)",
       "terms[0]: position: expected an array, found number"},
      {R"("position": [[0, 0], [1, 0], [2, 0]])", R"("position": [0, 0, 0])",
       "terms[0]: position: expected 2 (dim), found 3"},
      {R"("position": [[0, 0], [1, 0], [2, 0]])", R"("position": [[0, 0], [1, 0, 5], [2, 0]])",
       "terms[0]: position[1]: expected 2 (dim), found 3"},
      {R"("b": [[0, 1], [-1, 0]])", R"("b": [[0, 1], [-1]])", "terms[2]: b[1]: expected 2 (dim), found 1"},
      {R"("b": [[0, 1], [-1, 0]])", R"("b": [1, 2])",
       "terms[2]: b: expected 1 (one for each element), found 2"},
      {R"("terms": [)", R"("terms": [7, )", "terms[0]: expected an object, found number"},
  };
  for (const auto& each : kCases) {
    SCOPED_TRACE(each.to);
    const std::string text = replaced(good, each.from, each.to);
    const std::string error = error_of([&] { parse_stored_terms("\n" + text, "hard.jsonl"); });
    EXPECT_EQ(error.substr(0, std::string(each.error).size() + 14),
              "hard.jsonl:2: " + std::string(each.error));
  }
  EXPECT_EQ(error_of([] { parse_stored_terms("[3]"); }),
            "text:1: system 0: expected an object, found number");
}

TEST(SystemJson, ReadsMatricesByRows) {
  const auto read = parse_stored_terms(
      R"({"asterism_system": 2, "dim": 2, "nodes": 3, "start": [[0, 0], [1, 0], [2, 0]], "terms": [{"kind": "differences",)"
      R"( "nodes": [[0, 1, 2]], "target": [0, 0], "stiffness": 1, "a": [[1, 2], [3, 4]], "b": 0, "c": -1}]})");
  const Eigen::MatrixXd x{{1, 0, 5}, {2, 0, 11}};  // (1 + 2 2, 3 + 4 2) = (5, 11)
  EXPECT_EQ(energy(read.at(0).system, x), 0);
}

TEST(SystemJson, RefusesWhatCannotBeStored) {
  const auto error = [](const System& system, const Eigen::MatrixXd& start, const std::string& origin = "{}",
                        const std::string& name = {}) {
    return error_of([&] { static_cast<void>(to_json({system, start, name, origin})); });
  };
  const Eigen::MatrixXd start = Eigen::MatrixXd::Zero(2, 2);
  System system(2, 2);
  EXPECT_EQ(error(System(0, 2), start), "the system cannot be written: system has no nodes");
  EXPECT_EQ(error(system, start, "[]"), "the system cannot be written: origin is not an object but array");
  EXPECT_EQ(error(system, start, "{"),
            "the system cannot be written: origin:1: not JSON: syntax error while parsing object key - "
            "unexpected end "
            "of input; expected string literal");
  EXPECT_EQ(error(system, start, "{}", "\xff"),
            "the system cannot be written: its name or origin is not UTF-8");
  EXPECT_EQ(error(system, Eigen::MatrixXd::Constant(2, 2, NAN)),
            "the system cannot be written: x of node 0 is not finite");
  Links& links = system.add_links(all_pairs(2), System::all(1), System::all(-1));
  EXPECT_EQ(error(system, start),
            "the system cannot be written: links: stiffness of element 0 is negative or not finite: -1");
  links.values("stiffness").setOnes();
  EXPECT_EQ(error(system, start), "(none)");
  links.set_function([](std::size_t, const double*, const double*, double*, double*, double*) {});
  EXPECT_EQ(error(system, start),
            "the system cannot be written: links: the law is the user's function, which is stored only by a "
            "name: see "
            "add_link_law");
  links.set_law(LinkLaw::Hooke);
  system.add_elements(
      all_pairs(2), [](const auto&, const auto&, bool, ElementValues&) {}, false);
  EXPECT_EQ(
      error(system, start),
      "the system cannot be written: elements: a term whose energy is the user's function cannot be stored");
}

// The second example of the page is of this version.
TEST(SystemJson, IsAsDocumented) {
  std::ifstream page(ASTERISM_DOCS "/system-json.md");
  const std::string text{std::istreambuf_iterator<char>(page), {}}, fence = "\n```json\n";
  const std::size_t at = text.find(fence, text.find(fence) + 1) + fence.size();
  const auto systems = parse_stored_terms(text.substr(at, text.find("\n```", at) - at));
  ASSERT_EQ(systems.size(), 1u);
  EXPECT_EQ(systems[0].system.term_count(), 3);
  EXPECT_EQ(systems[0].system.term(1).chosen("law"), "rope");
  EXPECT_EQ(validate(systems[0].system, systems[0].start), "");
}

}  // namespace
}  // namespace asterism
