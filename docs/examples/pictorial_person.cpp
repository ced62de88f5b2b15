// A person of ten limbs is found in a drawing of two people and a lamp post.
#include <algorithm>
#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <cstddef>
#include <cstdio>
#include <random>
#include <vector>

struct Limb {
  const char* name;
  int parent;
  Eigen::Vector2d offset, half;  // from the parent's centre; half of the limb, from its centre to an end
};

const std::vector<Limb> kPerson{
    {"torso", -1, {0, 0}, {0, 9}},
    {"head", 0, {0, -14}, {0, 3}},
    {"left upper arm", 0, {-6, -4}, {-3, 5}},
    {"right upper arm", 0, {6, -4}, {3, 5}},
    {"left lower arm", 2, {-5, 9}, {-1, 5}},
    {"right lower arm", 3, {5, 9}, {1, 5}},
    {"left upper leg", 0, {-4, 16}, {-2, 6}},
    {"right upper leg", 0, {4, 16}, {2, 6}},
    {"left lower leg", 6, {-2, 13}, {0, 6}},
    {"right lower leg", 7, {2, 13}, {0, 6}},
};

constexpr int kWidth = 160, kHeight = 112;

struct Image {
  std::vector<float> ink = std::vector<float>(kWidth * kHeight);  // 1 where something is drawn
  bool holds(int x, int y) const { return 0 <= x && x < kWidth && 0 <= y && y < kHeight; }
  float& at(int x, int y) { return ink[static_cast<std::size_t>(y * kWidth + x)]; }
};

// Calls use(x, y) for the pixels of a limb whose centre is at (x, y).
template <typename Use>
void for_each_pixel(const Eigen::Vector2d& half, int x, int y, Use&& use) {
  for (int k = -8; k <= 8; ++k) {
    const Eigen::Vector2i at = (half * k / 8).array().round().cast<int>();
    use(x + at.x(), y + at.y());
  }
}

int main() {
  // Each limb of a person is up to 2 px away from where its parent expects it.
  std::minstd_rand random(7);
  Image image;
  std::vector<Eigen::Vector2i> truth;
  for (const int x : {50, 115}) {
    std::vector<Eigen::Vector2i> person;
    for (const Limb& limb : kPerson) {
      Eigen::Vector2i at(x, 45);
      if (limb.parent >= 0) {
        at = person[static_cast<std::size_t>(limb.parent)] + limb.offset.cast<int>();
        const auto right = static_cast<int>(random() % 5), down = static_cast<int>(random() % 5);
        at += Eigen::Vector2i(right - 2, down - 2);
      }
      person.push_back(at);
      if (x == 50 && person.size() == 6) continue;  // the right lower arm of the left person is hidden
      for_each_pixel(limb.half, at.x(), at.y(), [&](int u, int v) { image.at(u, v) = 1; });
    }
    if (truth.empty()) truth = person;
  }
  for (int y = 5; y < kHeight; ++y) image.at(84, y) = 1;                 // a lamp post
  for (float& ink : image.ink) ink = random() % 8 == 0 ? 1 - ink : ink;  // noise
  for (int y = 30; y < 60; ++y) image.at(115, y) = random() % 3 != 0;    // the other torso is faint

  // The cost of a limb at a pixel is the share of it that is not drawn there.
  std::vector<std::vector<float>> costs;
  std::vector<asterism::MapView<const float>> maps;
  std::vector<asterism::Joint> joints;
  for (const Limb& limb : kPerson) {
    auto& map = costs.emplace_back(kWidth * kHeight);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        float& cost = map[static_cast<std::size_t>(y * kWidth + x)];
        for_each_pixel(limb.half, x, y,
                       [&](int u, int v) { cost += (image.holds(u, v) ? 1 - image.at(u, v) : 1) / 17; });
      }
    }
    maps.emplace_back(map.data(), kWidth, kHeight);
    if (limb.parent < 0) continue;
    joints.push_back({limb.parent,
                      static_cast<int>(maps.size()) - 1,
                      {asterism::AxisCost::quadratic(0.01, limb.offset.x()),
                       asterism::AxisCost::quadratic(0.01, limb.offset.y())}});
  }

  asterism::PictorialStructure structure;
  asterism::PartPlacement best;
  const asterism::PictorialSummary summary = structure.solve(joints, maps, best);
  if (!summary.usable()) return 1;
  std::printf("%-16s %9s %9s %9s\n", "limb", "truth", "alone", "placement");
  for (std::size_t i = 0; i < kPerson.size(); ++i) {
    const auto alone = std::min_element(costs[i].begin(), costs[i].end()) - costs[i].begin();
    const auto at = best.positions.col(static_cast<int>(i));
    std::printf("%-16s %4d %4d %4d %4d %4d %4d\n", kPerson[i].name, truth[i].x(), truth[i].y(),
                static_cast<int>(alone % kWidth), static_cast<int>(alone / kWidth), at.x(), at.y());
  }
  std::vector<asterism::PartPlacement> people;
  structure.best_placements(2, 30, people);  // torsos at least 30 px apart
  for (const auto& one : people) {
    std::printf("person at %d %d, energy %.2f\n", one.positions(0, 0), one.positions(1, 0), one.energy);
  }
}
