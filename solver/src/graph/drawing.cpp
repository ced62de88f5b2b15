#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/split_mix.hpp>
#include <asterism/solver/base/stopwatch.hpp>
#include <asterism/solver/graph/drawing.hpp>
#include <asterism/solver/matrix/diagonalise.hpp>
#include <asterism/solver/run/executor.hpp>
#include <cmath>
#include <limits>
#include <new>
#include <numeric>
#include <optional>

#include "ruled_points.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

constexpr std::size_t kGrowth = 4;  // of the number of nodes from one shell to the next
constexpr double kLastStep =
    0.2;  // what all pairs of a node move it towards their minimum in the last iteration
constexpr std::size_t kBlock = 64;  // sources that are drawn one after the other are near in memory
constexpr std::size_t kBatch = 1 << 15;
constexpr int kThreads = 4;
constexpr int kBatches = 16;  // at a time

std::size_t at(int node) { return static_cast<std::size_t>(node); }

template <typename T>
void permute(std::span<T> values, detail::SplitMix64& random) {
  for (std::size_t k = values.size(); k > 1; --k) std::swap(values[k - 1], values[random.below(k)]);
}

bool is_set(const std::atomic<bool>* stop) {
  return stop != nullptr && stop->load(std::memory_order_relaxed);
}

/// The nodes of each component.
std::vector<std::vector<int>> nodes_of(const std::vector<int>& component) {
  std::vector<std::vector<int>> result;
  for (std::size_t i = 0; i < component.size(); ++i) {
    if (at(component[i]) == result.size()) result.emplace_back();
    result[at(component[i])].push_back(static_cast<int>(i));
  }
  return result;
}

/// The start of one component, of at least two nodes.
void scale_by_pivots(ShortestPaths& paths, const std::vector<int>& nodes, const std::vector<int>& place,
                     int dim, std::span<double> x, const std::atomic<bool>* stop) {
  const auto n = static_cast<Eigen::Index>(nodes.size());
  const Eigen::Index pivots = std::min<Eigen::Index>(n, 50);
  Eigen::MatrixXf squares(n, pivots);  // of the distances, later centred
  std::vector<double> nearest(nodes.size(), std::numeric_limits<double>::infinity());
  int pivot = nodes.front();
  double unit = 1;
  for (Eigen::Index k = 0; k < pivots && !is_set(stop); ++k) {
    paths.find(pivot);
    if (k == 0 && paths.lengths().back() > 0) unit = paths.lengths().back();
    double farthest = -1;
    for (std::size_t t = 0; t < nodes.size(); ++t) {
      const int node = paths.nodes()[t];
      const double length = paths.lengths()[t] / unit;
      squares(place[at(node)], k) = static_cast<float>(length * length);
      double& least = nearest[at(place[at(node)])];
      least = std::min(least, length);
      if (least > farthest) {
        farthest = least;
        pivot = node;
      }
    }
  }
  if (is_set(stop)) return;
  const Eigen::VectorXd means = squares.cast<double>().colwise().mean();
  const double mean = means.mean();
  const Eigen::VectorXf of_pivots = means.cast<float>();
  for (Eigen::Index i = 0; i < n; ++i) {
    const float of_node = squares.row(i).mean() - static_cast<float>(mean);
    squares.row(i) = -0.5F * (squares.row(i) - of_pivots.transpose()).array() + 0.5F * of_node;
  }
  Eigen::MatrixXd products = Eigen::MatrixXd::Zero(pivots, pivots);
  constexpr Eigen::Index kRows = 4096;  // the sums of more would be rounded
  for (Eigen::Index i = 0; i < n; i += kRows) {
    const auto rows = squares.middleRows(i, std::min(kRows, n - i));
    products += (rows.transpose() * rows).cast<double>();
  }
  Eigen::MatrixXd axes;
  detail::diagonalise(products, axes);
  std::vector<Eigen::Index> order(static_cast<std::size_t>(pivots));  // by falling eigenvalue
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(),
            [&](Eigen::Index a, Eigen::Index b) { return products(a, a) > products(b, b); });
  const double share = std::sqrt(static_cast<double>(n) / static_cast<double>(pivots));
  detail::SplitMix64 random(1);
  const double noise =
      1e-3 * unit * std::sqrt(mean);  // for nodes that would coincide, and for what would be flat
  for (int c = 0; c < dim; ++c) {
    Eigen::VectorXf along = Eigen::VectorXf::Zero(n);
    if (c < pivots) {
      const Eigen::Index k = order[static_cast<std::size_t>(c)];
      const double value = std::sqrt(std::max(products(k, k), 0.0));
      if (value > 1e-12) along = squares * (axes.col(k) * std::sqrt(share / value)).cast<float>();
    }
    for (Eigen::Index i = 0; i < n; ++i) {
      x[at(nodes[static_cast<std::size_t>(i)]) * at(dim) + at(c)] =
          static_cast<double>(along[i]) * unit + noise * random.symmetric();
    }
  }
}

/// Pairs of a node, the source, with others, which they move: runs of pairs that are alike.
struct Star {
  int source;
  std::size_t end;  // in the runs of the batch
};
struct Run {
  std::size_t end;  // in the nodes of the batch
  double length;
  double weight;  // times the number of pairs that each stands for
};
struct Batch {
  std::vector<Star> stars;
  std::vector<Run> runs;
  std::vector<int> nodes;
};

/// Sources whose pairs are drawn together, in one iteration.
struct Sources {
  std::vector<int> nodes;
  std::vector<int> shells;  // of each: how many are drawn
  int iteration = 0;
};

struct Component {
  std::size_t size = 0;
  double pairs = 0;   // that move a node in an iteration, on average
  double weight = 0;  // of all pairs of a node, on average
  double step = 0;    // in the iteration that is moved
};

class Drawing {
 public:
  Drawing(const Graph& graph, const DrawingOptions& options) : options_(options), random_(options.seed) {
    if (options.iterations <= 0) options_.iterations = graph.nodes() <= 100000 ? 60 : 20;
    // Breadth-first order, so that near nodes are near in memory.
    std::vector<int> component = graph.components();
    order_.reserve(component.size());
    ShortestPaths search(graph);
    for (int i = 0, next = 0; i < graph.nodes(); ++i) {
      if (component[at(i)] < next) continue;
      search.find(i);
      order_.insert(order_.end(), search.nodes().begin(), search.nodes().end());
      ++next;
    }
    graph_.emplace_back(graph.renumbered(order_));
    component_.reserve(component.size());
    for (const int node : order_) component_.push_back(component[at(node)]);
    for (const int c : component_) {
      if (at(c) == components_.size()) components_.emplace_back();
      ++components_[at(c)].size;
    }
    nearest_ = std::clamp<std::size_t>(kPairs / std::max<std::size_t>(component.size(), 1), kLeast, kMost);
    // Nodes are moved by one thread, which is a third of the work.
    paths_.assign(at(std::min(detail::thread_count(options.threads), kThreads)), ShortestPaths(graph_[0]));
    measure();
  }

  /// x keeps to the rules, which have to be right, and to live as long as this.
  void set_rules(int dim, RuledPoints& rules) {
    rules_ = &rules;
    for (int k = 0; k < graph_[0].nodes(); ++k) {
      for (int axis = 0; axis < dim; ++axis) is_held_.push_back(rules.is_fixed(k, axis) ? 1 : 0);
    }
    if (std::find(is_held_.begin(), is_held_.end(), 1) == is_held_.end()) is_held_.clear();
  }

  /// Row k of x is node order()[k].
  const std::vector<int>& order() const { return order_; }

  template <int Dim>
  Summary run(std::vector<double>& x, const std::vector<double>& anchors,
              const std::vector<double>& weights) {
    Summary summary;
    summary.iterations = 0;
    if (rules_ != nullptr) rules_->snap(x);
    const std::vector<double> start = x;
    pulls_.clear();
    for (std::size_t i = 0; i < weights.size(); ++i)
      pulls_.push_back(weights[i] > 0 ? weights[i] / std::max(components_[at(component_[i])].pairs, 1.0) : 0);
    std::vector<Sources> round, next = sources();
    std::vector<Batch> batches, others;
    set_steps(0);
    while (!next.empty() || !round.empty()) {
      if (is_set(options_.stop) || is_bad_) break;
      // While one thread moves nodes by the pairs of the last round, others draw those of the next one.
      others.resize(next.size());
      detail::for_each_task(static_cast<int>(paths_.size()), static_cast<int>(next.size()) + 1,
                            [&](int worker, int task) {
                              if (task > 0) {
                                draw(next[at(task - 1)], paths_[at(worker)], others[at(task - 1)]);
                              } else {
                                move<Dim>(round, batches, x, anchors);
                              }
                            });
      std::swap(batches, others);
      round = std::move(next);
      next = sources();
    }
    summary.status = is_set(options_.stop) ? Status::Interrupted : Status::MaxIterations;
    if (is_bad_) {
      summary.status = Status::InvalidInput;
      summary.message = "the weight of a path, its length ^ -power, is out of range";
    }
    if (!summary.usable() || summary.status == Status::Interrupted) return summary;
    summary.iterations = options_.iterations;
    constexpr int kPasses = 300;
    int passes = 0;
    if (rules_ != nullptr && !rules_->finish(x, kPasses, options_.stop, passes))
      return detail::refused("sgd", kNoRoom);
    std::array<double, 2> energies = energies_of<Dim>(start, x, anchors, weights);
    if (is_set(options_.stop)) {
      summary.status = Status::Interrupted;
      return summary;
    }
    if (rules_ == nullptr && !(energies[1] < energies[0])) {
      summary.status = Status::NoProgress;
      x = start;
      energies[1] = energies[0];
    }
    summary.initial_energy = energies[0];
    summary.final_energy = energies[1];
    return summary;
  }

 private:
  static constexpr std::size_t kPairs = 320000;  // of all nodes with their nearest ones
  static constexpr std::size_t kLeast = 8, kMost = 64;

  std::size_t shell_end(int shell) const {
    std::size_t end = nearest_;
    for (int k = 0; k < shell; ++k) end *= kGrowth;
    return end;
  }

  double weight_of(double length) {
    const double weight = options_.power == 2 ? 1 / (length * length) : std::pow(length, -options_.power);
    if (!(weight > 0 && weight < std::numeric_limits<double>::infinity())) is_bad_ = true;
    return weight;
  }

  /// The weight of all pairs of a node, from a few nodes of each component.
  void measure() {
    constexpr std::size_t kSample = 8;
    std::size_t first = 0;
    for (Component& component : components_) {
      const std::size_t count = std::min(component.size, kSample);
      for (std::size_t k = 0; k < count && component.size > 1 && !is_set(options_.stop); ++k) {
        const std::size_t node = first + (count == component.size ? k : random_.below(component.size));
        paths_[0].find(static_cast<int>(node));
        for (const double length : paths_[0].lengths().subspan(1))
          component.weight += weight_of(length) / static_cast<double>(count);
      }
      first += component.size;
      const auto others = static_cast<double>(component.size - 1);
      int shells = 0;
      while (static_cast<double>(shell_end(shells)) < others) ++shells;
      component.pairs = static_cast<double>(nearest_) * (1 + shells * (1 - 1.0 / kGrowth));
      component.pairs = std::min(component.pairs, others);
    }
  }

  /// The step of a component in an iteration: by how much the weights of its pairs are multiplied. All of a
  /// node's together move it nearly to each one's distance at first, and by kLastStep in the end.
  void set_steps(int iteration) {
    const double time = options_.iterations > 1 ? iteration / (options_.iterations - 1.0) : 1;
    for (Component& component : components_) {
      if (component.size < 2) continue;
      const double first = options_.is_refining ? std::min(component.pairs, 1.0) : component.pairs;
      component.step = first * std::pow(kLastStep / first, time) / component.weight;
    }
    moved_ = iteration;
  }

  /// The next sources, at most kBatches; none at the end.
  std::vector<Sources> sources() {
    std::vector<Sources> result;
    while (result.size() < kBatches && iteration_ < options_.iterations) {
      if (position_ == 0) shuffle();
      Sources some;
      some.iteration = iteration_;
      std::size_t pairs = 0;
      while (position_ < sequence_.size() && pairs < kBatch) {
        const int node = sequence_[position_++];
        const std::size_t others = components_[at(component_[at(node)])].size - 1;
        if (others == 0) continue;
        // Every fourth source has a second shell, every fourth of those a third one, and so on: fewer of one
        // region by chance would be less exact.
        int shells = 0;
        ++number_;
        for (std::uint64_t k = number_; shell_end(shells) < others && k % kGrowth == 0; k /= kGrowth)
          ++shells;
        some.nodes.push_back(node);
        some.shells.push_back(shells);
        pairs += std::min(shell_end(shells), others);
      }
      if (!some.nodes.empty()) result.push_back(std::move(some));
      if (position_ == sequence_.size()) {
        position_ = 0;
        ++iteration_;
      }
    }
    return result;
  }

  /// Blocks in any order, and the nodes of each in any order.
  void shuffle() {
    const std::size_t n = order_.size();
    std::vector<std::size_t> blocks((n + kBlock - 1) / kBlock);
    std::iota(blocks.begin(), blocks.end(), 0);
    permute(std::span(blocks), random_);
    sequence_.clear();
    number_ = random_();
    for (const std::size_t block : blocks) {
      const std::size_t first = sequence_.size();
      for (std::size_t i = block * kBlock; i < std::min(n, (block + 1) * kBlock); ++i)
        sequence_.push_back(static_cast<int>(i));
      permute(std::span(sequence_).subspan(first), random_);
    }
  }

  void draw(const Sources& sources, ShortestPaths& paths, Batch& batch) {
    batch.stars.clear();
    batch.runs.clear();
    batch.nodes.clear();
    for (std::size_t s = 0; s < sources.nodes.size() && !is_set(options_.stop); ++s) {
      const int source = sources.nodes[s];
      paths.find(source, shell_end(sources.shells[s]) + 1);
      const std::span<const int> nodes = paths.nodes();
      const std::span<const double> lengths = paths.lengths();
      std::size_t end = batch.nodes.size();
      batch.nodes.insert(batch.nodes.end(), nodes.begin() + 1, nodes.end());
      std::size_t end_of_shell = nearest_;
      double share = 1;
      for (std::size_t k = 1, last = 1; k < nodes.size(); k = last) {
        if (k > end_of_shell) {
          end_of_shell *= kGrowth;
          share *= static_cast<double>(kGrowth);
        }
        while (last < nodes.size() && last <= end_of_shell && lengths[last] == lengths[k]) ++last;
        end += last - k;
        batch.runs.push_back({end, lengths[k], share * weight_of(lengths[k])});
      }
      batch.stars.push_back({source, batch.runs.size()});
    }
  }

  void push(std::vector<double>& x) const {
    if (rules_ != nullptr) rules_->push(x);
  }

  template <int Dim>
  void move(const std::vector<Sources>& round, const std::vector<Batch>& batches, std::vector<double>& x,
            const std::vector<double>& anchors) {
    for (std::size_t k = 0; k < round.size(); ++k) {
      if (round[k].iteration != moved_) {
        push(x);
        set_steps(round[k].iteration);
      }
      move<Dim>(batches[k], x, anchors);
    }
  }

  template <int Dim>
  void move(const Batch& batch, std::vector<double>& x, const std::vector<double>& anchors) const {
    const char* const held = is_held_.empty() ? nullptr : is_held_.data();
    std::size_t r = 0, k = 0;
    for (const Star& star : batch.stars) {
      const double step = components_[at(component_[at(star.source)])].step;
      double from[Dim];
      std::copy_n(&x[at(star.source) * Dim], Dim, from);
      for (; r < star.end; ++r) {
        const Run& run = batch.runs[r];
        const double share = std::min(1.0, step * run.weight);
        for (; k < run.end; ++k) {
          const int node = batch.nodes[k];
          const double pull = pulls_.empty() ? 0 : pulls_[at(node)];
          if (std::isinf(pull)) continue;
          double* const to = &x[at(node) * Dim];
          double along[Dim];
          double square = 0;
          for (int c = 0; c < Dim; ++c) {
            along[c] = to[c] - from[c];
            square += along[c] * along[c];
          }
          if (square == 0) {  // any direction
            along[node % Dim] = square = 1;
            to[node % Dim] += 1e-6 * run.length;
          }
          const double factor = share * (run.length / std::sqrt(square) - 1);
          for (int c = 0; c < Dim; ++c) {
            if (held == nullptr || held[at(node) * Dim + at(c)] == 0) to[c] += factor * along[c];
          }
          if (pull == 0) continue;
          const double back = std::min(1.0, step * pull);
          for (int c = 0; c < Dim; ++c) to[c] += back * (anchors[at(node) * Dim + at(c)] - to[c]);
        }
      }
    }
  }

  /// Half the stress of two drawings, estimated from the same pairs.
  template <int Dim>
  std::array<double, 2> energies_of(const std::vector<double>& a, const std::vector<double>& b,
                                    const std::vector<double>& anchors, const std::vector<double>& weights) {
    std::array<double, 2> sums{};
    nearest_ *= 4;  // more than in an iteration, as no other ones follow
    --iteration_;
    std::vector<Batch> batches(kBatches);
    std::array<std::array<double, 2>, kBatches> parts;
    for (std::vector<Sources> some = sources(); !some.empty() && !is_set(options_.stop); some = sources()) {
      detail::for_each_task(static_cast<int>(paths_.size()), static_cast<int>(some.size()),
                            [&](int worker, int task) {
                              Batch& batch = batches[at(task)];
                              draw(some[at(task)], paths_[at(worker)], batch);
                              parts[at(task)] = {energy_of<Dim>(batch, a), energy_of<Dim>(batch, b)};
                            });
      for (std::size_t k = 0; k < some.size(); ++k) {
        sums[0] += parts[k][0];
        sums[1] += parts[k][1];
      }
    }
    for (std::size_t i = 0; i < weights.size(); ++i) {
      if (!(weights[i] > 0) || std::isinf(weights[i])) continue;
      for (std::size_t c = i * Dim; c < (i + 1) * Dim; ++c) {
        sums[0] += weights[i] / 2 * (a[c] - anchors[c]) * (a[c] - anchors[c]);
        sums[1] += weights[i] / 2 * (b[c] - anchors[c]) * (b[c] - anchors[c]);
      }
    }
    return sums;
  }

  template <int Dim>
  static double energy_of(const Batch& batch, const std::vector<double>& x) {
    double sum = 0;
    std::size_t r = 0, k = 0;
    for (const Star& star : batch.stars) {
      for (; r < star.end; ++r) {
        const Run& run = batch.runs[r];
        double squares = 0;
        for (; k < run.end; ++k) {
          double square = 0;
          for (int c = 0; c < Dim; ++c) {
            const double along = x[at(batch.nodes[k]) * Dim + at(c)] - x[at(star.source) * Dim + at(c)];
            square += along * along;
          }
          const double misfit = run.length - std::sqrt(square);
          squares += misfit * misfit;
        }
        sum += run.weight / 4 * squares;  // a pair may come from both of its ends
      }
    }
    return sum;
  }

  DrawingOptions options_;
  detail::SplitMix64 random_;
  std::vector<int> order_;
  std::vector<Graph> graph_;  // one, renumbered
  std::vector<int> component_;
  std::vector<Component> components_;
  std::size_t nearest_ = 0;
  std::vector<ShortestPaths> paths_;  // of each thread
  std::vector<double> pulls_;  // of the anchors, for each pair that moves a node; empty if there are none
  RuledPoints* rules_ = nullptr;
  std::vector<char> is_held_;  // coordinates that the rules give; empty if there are none
  std::vector<int> sequence_;  // of the sources of an iteration
  std::size_t position_ = 0;
  std::uint64_t number_ = 0;  // of the last source, counted from a random number
  int iteration_ = 0;         // of the next sources
  int moved_ = 0;             // the iteration whose steps are set
  std::atomic<bool> is_bad_ = false;
};

}  // namespace

namespace {

const char* problem_of(int dim, std::size_t nodes, std::span<const double> x, const DrawingAnchors& anchors) {
  const std::size_t numbers = nodes * at(std::max(dim, 0));
  const auto [positions, weights] = anchors;
  if (dim != 2 && dim != 3) return "dim must be 2 or 3";
  if (x.size() != numbers) return "x must have dim coordinates for each node";
  if (!std::all_of(x.begin(), x.end(), [](double value) { return std::isfinite(value); }))
    return "x must be finite";
  if (positions.empty() && weights.empty()) return nullptr;
  if (positions.size() != numbers || weights.size() != nodes)
    return "anchors must have dim coordinates and a weight for each node";
  for (std::size_t c = 0; c < numbers; ++c) {
    const double weight = weights[c / at(dim)];
    if (!(weight >= 0)) return "the weights of anchors must be at least 0";
    if (weight > 0 && !std::isfinite(positions[c])) return "anchors must be finite";
  }
  return nullptr;
}

}  // namespace

std::vector<double> pivot_start(const Graph& graph, int dim, const std::atomic<bool>* stop) {
  std::vector<double> x(at(graph.nodes()) * at(dim));
  const std::vector<std::vector<int>> components = nodes_of(graph.components());
  std::size_t largest = 0;
  for (const std::vector<int>& nodes : components) largest = std::max(largest, nodes.size());
  detail::require_memory(static_cast<double>(largest) * 50 * sizeof(float));
  std::vector<int> place(at(graph.nodes()));
  ShortestPaths paths(graph);
  for (const std::vector<int>& nodes : components) {
    if (is_set(stop)) break;
    for (std::size_t k = 0; k < nodes.size(); ++k) place[at(nodes[k])] = static_cast<int>(k);
    if (nodes.size() > 1) scale_by_pivots(paths, nodes, place, dim, x, stop);
  }
  return x;
}

Summary draw_graph(const Graph& graph, int dim, std::span<double> x, const DrawingAnchors& anchors,
                   const DrawingOptions& options, const DrawingRules& rules) {
  const detail::Stopwatch stopwatch;
  if (const char* problem = problem_of(dim, at(graph.nodes()), x, anchors))
    return detail::refused("sgd", problem);
  Summary summary;
  const auto work = [&] {
    // A round may have the pairs of all nodes with some sources; 200 bytes a node are for all else.
    detail::require_memory(static_cast<double>(graph.nodes()) * (4 * (sizeof(Run) + sizeof(int)) + 200));
    Drawing drawing(graph, options);
    const std::vector<int>& order = drawing.order();
    std::optional<RuledPoints> ruled;
    if (!rules.empty()) {
      ruled.emplace(dim, graph.nodes(), rules, order);
      if (!ruled->error().empty()) {
        summary = detail::refused("sgd", std::string_view(ruled->error()));
        return;
      }
      drawing.set_rules(dim, *ruled);
    }
    std::vector<double> points, positions, weights;
    for (const int node : order) {
      if (!anchors.weights.empty()) weights.push_back(anchors.weights[at(node)]);
      const bool is_held = !weights.empty() && std::isinf(weights.back());
      for (std::size_t c = at(node) * at(dim); c < at(node + 1) * at(dim); ++c) {
        points.push_back(is_held ? anchors.positions[c] : x[c]);
        if (!anchors.weights.empty()) positions.push_back(anchors.positions[c]);
      }
    }
    summary =
        dim == 3 ? drawing.run<3>(points, positions, weights) : drawing.run<2>(points, positions, weights);
    if (!summary.usable()) return;
    for (std::size_t k = 0; k < order.size(); ++k)
      std::copy_n(&points[k * at(dim)], dim, &x[at(order[k]) * at(dim)]);
  };
  detail::attempt<std::bad_alloc>(work, [&](const std::bad_alloc& error) {
    summary.status = Status::OutOfMemory;
    summary.message = detail::memory_message(error);
  });
  summary.solver = "sgd";
  if (summary.usable()) summary.message = "";
  summary.seconds = stopwatch.seconds();
  return summary;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
