// A constellation of superpixels, after DGT (Cai et al., "Robust deformable and occluded object tracking with
// dynamic graph", TIP 2014): the parts are the object's superpixels, and the candidates are those of the
// frame, weighted by how far their color is the object's rather than its surroundings'. Matching is by color
// and place; springs to the nearest neighbours are the geometric term. The graph is dynamic: parts that are
// no longer matched leave, and candidates on the object that are not yet parts join. It is an example and not
// a tracker of the library, as plain KCF is better.

#include <algorithm>
#include <asterism/parts/features/patch.hpp>
#include <asterism/parts/features/slic.hpp>
#include <asterism/trackers/around/gated.hpp>
#include <asterism/trackers/constellation/elastic.hpp>
#include <asterism/trackers/tracker/program.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

using namespace asterism;

class SuperpixelTracker : public TrackerBase<SuperpixelTracker> {
 public:
  TrackResult standing() const { return parts_.standing(pose_, Size2::Constant(kSide * spacing_)); }

 private:
  friend TrackerBase<SuperpixelTracker>;
  static constexpr std::string_view kName = "SuperpixelTracker";
  static constexpr int kSide = 6;  // of a superpixel [template pixels]
  // The object is resampled to kTemplateSide, its mean side, with kPadding times as much of its surroundings.
  // The window's sides are limited, for thin objects [template pixels].
  static constexpr double kTemplateSide = 40, kPadding = 1.5, kMinWindow = 12, kMaxWindow = 64 * kSide;
  static constexpr double kColorSigma = 8;      // deviation from frame to frame [CIELAB units]
  static constexpr int kNeighbours = 6;         // links of a part
  static constexpr double kReach = 0.1;         // of evidence [object's mean side]
  static constexpr double kLearningRate = 0.1;  // of a part's color
  static constexpr double kMatch = 0.3;         // a part that matches worse is not seen, ...
  static constexpr int kForgetAfter = 10;       // ... and leaves after so many frames
  static constexpr double kLostBelow = 0.05;    // mean match of the parts
  using Points = ElasticConstellation::Points;
  // The superpixels of a window: positions in the image, colors, areas with a mean of about 1, and how far
  // the color is the object's rather than its surroundings', in [0, 1].
  struct Candidates {
    Points positions;
    Eigen::ArrayX3f colors;
    Eigen::ArrayXf areas, foreground;
  };

  void start(const Frame& frame, const cv::Rect2d& box) {
    color_ = frame.has_color();
    pose_ = ObjectPose(box);
    parts_.assign(Points(2, 0), Points(2, 0), Topology<>::full(0));
    colors_.resize(0, 3), background_.resize(0, 3);
    unseen_.clear();
    spacing_ = pose_.mean_side() / kTemplateSide;
    renew(cut(frame));
  }

  TrackResult follow(const Frame& frame) {
    const Candidates seen = cut(frame);
    const Eigen::ArrayXXf likeness = alike(colors_, seen.colors);

    // First the motion that most parts share, then each part's candidates near the moved part.
    const int n = parts_.size();
    parts_.placement().colwise() += common_displacement(seen, likeness);
    const double sigma = kSide * spacing_;
    std::vector<Evidence> evidence(static_cast<std::size_t>(n));
    Eigen::ArrayX3f matched = colors_;
    for (int i = 0; i < n; ++i) {
      Evidence& part = evidence[static_cast<std::size_t>(i)];
      part.position = parts_.placement().col(i);
      double total = 0;
      Point2 mean = Point2::Zero();
      Eigen::Matrix2d moments = Eigen::Matrix2d::Zero();
      Eigen::Array3d color = Eigen::Array3d::Zero();
      for (int c = 0; c < seen.areas.size(); ++c) {
        const Point2 offset = seen.positions.col(c) - part.position;
        const double near = std::exp(-offset.squaredNorm() / (2 * sigma * sigma));
        const double match = near * static_cast<double>(likeness(i, c) * std::sqrt(seen.foreground[c]));
        const double weight = match * static_cast<double>(seen.areas[c]);
        total += weight, mean += weight * offset, moments += weight * offset * offset.transpose();
        color += weight * seen.colors.row(c).transpose().cast<double>();
        part.peak = std::max(part.peak, match);
      }
      if (!(total > 1e-6)) {
        part.peak = 0;
        continue;
      }
      mean /= total;
      part.position += mean;
      part.covariance =
          moments / total - mean * mean.transpose() + sigma * sigma / 12 * Eigen::Matrix2d::Identity();
      matched.row(i) = (color / total).transpose().cast<float>();
    }

    parts_.place(pose_, evidence);
    Eigen::VectorXd weights(n);
    for (int i = 0; i < n; ++i) weights[i] = evidence[static_cast<std::size_t>(i)].peak;
    pose_.move_to(fit_pose(parts_.layout(), parts_.placement(), weights, pose_, kReach).transform);
    pose_.keep_in(frame);

    TrackResult result;
    const Points expected = parts_.posed(pose_);
    for (int i = 0; i < n; ++i) {
      const Evidence& part = evidence[static_cast<std::size_t>(i)];
      const double strain =
          (parts_.placement().col(i) - expected.col(i)).norm() / (kReach * pose_.mean_side());
      const double success = part.peak / (1 + strain * strain);
      const bool works = success > kMatch;
      result.confidence += success / n;
      int& unseen = unseen_[static_cast<std::size_t>(i)];
      unseen = works ? 0 : unseen + 1;
      if (works)
        colors_.row(i) += static_cast<float>(kLearningRate) * (matched.row(i) - colors_.row(i));
      else
        parts_.placement().col(i) = expected.col(i);
      result.parts.push_back(
          {parts_.placement().col(i), Size2::Constant(sigma), part.position, success, works});
    }
    result.links = parts_.links();
    result.box = pose_.box();
    result.angle = pose_.angle();
    result.confidence = std::clamp(result.confidence, 0.0, 1.0);
    result.lost = result.confidence < kLostBelow;
    if (!result.lost) renew(seen);
    spacing_ = pose_.mean_side() / kTemplateSide;
    return result;
  }

  // The superpixels of the window about the object.
  Candidates cut(const Frame& frame) const {
    const Size2 whole = pose_.size() + Size2::Constant(kPadding * pose_.mean_side());
    const auto pixels = [&](double side) {
      return static_cast<int>(std::clamp(std::round(side / spacing_), kMinWindow, kMaxWindow));
    };
    const cv::Size grid(pixels(whole.x()), pixels(whole.y()));
    const Size2 pixel = whole.cwiseQuotient(Size2(grid.width, grid.height));
    cv::Mat patch;
    sample_patch(color_ && !frame.bgr().empty() ? frame.bgr() : frame.gray(), pose_.centre(), whole, grid,
                 patch);
    if (patch.channels() == 1) cv::cvtColor(patch, patch, cv::COLOR_GRAY2BGR);
    patch.convertTo(patch, CV_32F, 1.0 / 255);
    cv::cvtColor(patch, patch, cv::COLOR_BGR2Lab);
    const auto colors = Eigen::Map<const Eigen::Array<float, Eigen::Dynamic, 3, Eigen::RowMajor>>(
        patch.ptr<float>(), grid.area(), 3);
    const SuperpixelMap map = slic(colors, grid.width, {.side = kSide, .compactness = 10, .iterations = 5});

    Candidates result{.positions = Points::Zero(2, map.areas.size()),
                      .colors = map.colors,
                      .areas = map.areas / static_cast<float>(kSide * kSide),
                      .foreground = Eigen::ArrayXf::Ones(map.areas.size())};
    for (int i = 0; i < grid.area(); ++i)
      result.positions.col(map.labels[static_cast<std::size_t>(i)]) += Point2(i % grid.width, i / grid.width);
    const Point2 middle = Point2(grid.width - 1, grid.height - 1) / 2;
    for (Eigen::Index c = 0; c < result.positions.cols(); ++c)
      result.positions.col(c) =
          pose_.centre() +
          pixel.cwiseProduct(result.positions.col(c) / static_cast<double>(map.areas[c]) - middle);

    // How far each color is the object's: its density among the parts' colors, against that in the
    // surroundings.
    if (colors_.rows() > 0 && background_.rows() > 0) {
      const Eigen::ArrayXf object = alike(colors_, map.colors).colwise().mean().transpose(),
                           around = alike(background_, map.colors).colwise().mean().transpose();
      result.foreground = (object + 1e-3f) / (object + around + 2e-3f);
    }
    return result;
  }

  // exp(-|c - c'|^2 / (2 sigma^2)), one row per color in `a`.
  static Eigen::ArrayXXf alike(const Eigen::ArrayX3f& a, const Eigen::ArrayX3f& b) {
    Eigen::ArrayXXf squares = Eigen::ArrayXXf::Zero(a.rows(), b.rows());
    for (int k = 0; k < 3; ++k)
      squares += (a.col(k).replicate(1, b.rows()) - b.col(k).transpose().replicate(a.rows(), 1)).square();
    return (squares / static_cast<float>(-2 * kColorSigma * kColorSigma)).exp();
  }

  // The displacement that has the most votes of pairs of a part and a candidate, in cells of half a
  // superpixel, up to the window's margin.
  Point2 common_displacement(const Candidates& seen, const Eigen::ArrayXXf& likeness) const {
    const double cell = kSide * spacing_ / 2;
    const int reach = static_cast<int>(kPadding / 2 * pose_.mean_side() / cell) + 1;
    cv::Mat votes = cv::Mat::zeros(2 * reach + 1, 2 * reach + 1, CV_32F);
    for (int i = 0; i < parts_.size(); ++i)
      for (int c = 0; c < seen.areas.size(); ++c) {
        const Point2 d = (seen.positions.col(c) - parts_.placement().col(i)) / cell;
        const int col = static_cast<int>(std::lround(d.x())) + reach,
                  row = static_cast<int>(std::lround(d.y())) + reach;
        if (col < 0 || row < 0 || col >= votes.cols || row >= votes.rows) continue;
        votes.at<float>(row, col) += likeness(i, c) * seen.foreground[c] * seen.areas[c];
      }
    cv::GaussianBlur(votes, votes, {}, 1, 1, cv::BORDER_CONSTANT);
    double most = 0;
    Point2 best = Point2::Zero();
    for (int row = 0; row < votes.rows; ++row)
      for (int col = 0; col < votes.cols; ++col) {
        const Point2 d(col - reach, row - reach);
        // A small displacement is more likely.
        const double vote =
            static_cast<double>(votes.at<float>(row, col)) * std::exp(-d.squaredNorm() / (reach * reach));
        if (vote > most) most = vote, best = d;
      }
    return cell * best;
  }

  // Lets parts leave and join, and learns the background's colors from this frame.
  void renew(const Candidates& seen) {
    const PlaneTransform to_object = pose_.transform().inverse();
    std::vector<Point2> layout, placement;
    std::vector<Eigen::Array3f> colors, background;
    std::vector<int> unseen;
    for (int i = 0; i < parts_.size(); ++i) {
      const int frames = unseen_[static_cast<std::size_t>(i)];
      if (frames >= kForgetAfter) continue;
      layout.push_back(parts_.layout().col(i)), placement.push_back(parts_.placement().col(i));
      colors.push_back(colors_.row(i).transpose()), unseen.push_back(frames);
    }
    const double spacing = 0.7 * kSide * spacing_;
    for (int c = 0; c < seen.areas.size(); ++c) {
      const Point2 position = seen.positions.col(c), in_object = to_object(position);
      if (!pose_.covers(in_object)) {
        background.push_back(seen.colors.row(c).transpose());
        continue;
      }
      const auto too_near = [&](const Point2& other) { return (other - position).norm() < spacing; };
      if (seen.foreground[c] < 0.5f || std::any_of(placement.begin(), placement.end(), too_near)) continue;
      layout.push_back(in_object), placement.push_back(position);
      colors.push_back(seen.colors.row(c).transpose()), unseen.push_back(0);
    }

    const auto columns = [](const std::vector<Point2>& points) {
      Points result(2, std::ssize(points));
      for (Eigen::Index i = 0; const Point2& point : points) result.col(i++) = point;
      return result;
    };
    const auto rows = [](const std::vector<Eigen::Array3f>& list) {
      Eigen::ArrayX3f result(std::ssize(list), 3);
      for (Eigen::Index i = 0; const Eigen::Array3f& color : list) result.row(i++) = color.transpose();
      return result;
    };
    parts_.assign(columns(layout), columns(placement), Topology<>::k_nearest(columns(layout), kNeighbours));
    colors_ = rows(colors), background_ = rows(background);
    unseen_ = unseen;
  }

  ElasticConstellation parts_{{.deformation = 0.1, .reach = kReach}};
  ObjectPose pose_;
  Eigen::ArrayX3f colors_, background_;  // of the parts, and of what is around the object
  std::vector<int> unseen_;              // frames since each part was matched
  double spacing_ = 1;                   // image pixels per template pixel, in the last frame
  bool color_ = false;                   // learned in color
};

int main(int argc, char** argv) { return run_program(GatedTracker{SuperpixelTracker()}, argc, argv); }
