#pragma once

// The border between asterism.pose and its kernels, which are compiled once for each instruction set (see
// batch_kernels.hpp for what that forbids here).
#include <cstddef>

namespace asterism::pose_kernels {

/// Joints side by side, one in each lane of a vector. In arrays of lanes, each number is followed by that of
/// the next lane; they are aligned to vectors. D = 2 or 3, E = D (D + 1) / 2 entries of an upper triangle.
struct JointGroup {
  std::ptrdiff_t frames, views;
  // For all joints.
  const double* cameras;       ///< (views, 12): R by rows and t; 3-D only
  const double* least_depth;   ///< (views): in front of the camera; 3-D only
  const double* rarity;        ///< (views): the density of an outlier, 1 over the image's area [px^-2]
  const double* coefficients;  ///< (frames - 2, 3): of the changes of velocity
  double centre[3];            ///< the prior's point

  // Detections, in lanes.
  double* sights;  ///< (frames, views, 6): the point in the image, and in 3-D the pixels for a unit (2, 2)
  double* prior;   ///< (frames, views): the probability beforehand that it is no outlier; 0 if there is none
  double* doubt;   ///< (frames, views): its variance as a multiple of `variance`; or null
  double* weight;  ///< (frames, views)
  double* curvature;  ///< (frames, views): of the logarithm of Student's t distribution, in the mean over all
                      ///< directions
  double* trust;      ///< (frames, views): its probability times its weight in Student's t distribution
  double* probability;  ///< (frames, views): that it is no outlier
  double* variance;     ///< (views)
  double* offset;       ///< (views, 2)

  // Points, in lanes.
  double* points;      ///< (frames, D)
  double* covariance;  ///< (frames, E)
  double* spread;      ///< (frames - 2): the covariance's share in the square of each change of velocity
  double* calm;        ///< (frames - 2): the weight of each change, times `motion`
  double* motion;      ///< one: the variance of changes
  double* weak;        ///< one: the information of the prior, which posterior sets:
  double least_weak, weak_share;  ///< the greater of this and of this share of the greatest stiffness
  double* past;        ///< (2 D, 2 D): what forgotten frames say about the first two points; or null
  double* past_right;  ///< (2 D)

  // What the last posterior was computed from, and its factors.
  double* stiffness;                       ///< (frames - 2)
  double* information;                     ///< (frames, E), with that of the prior, without the past
  double* right;                           ///< (frames, D)
  double *inverse, *next, *second, *path;  ///< (frames, E), (frames, D, D), (frames), (frames, D)
  double* change;                          ///< (frames): see posterior
};

/// Sums over the frames of a group, in lanes; arrays (views, ..).
struct DetectionSums {
  double *square, *count;       ///< of trust * square / doubt, and of probability
  double *rows, *errors;        ///< (views, 2, D), (views, 2): of the residuals times probability
  double *shared, *neighbours;  ///< of errors of neighbouring frames times each other, and of the weights
  double* before;               ///< (views, 2): the errors in the frame before
};

/// The functions for one instruction set and dimension.
struct Kernels {
  int lanes;
  /// Expectation: probability and trust of each detection. sums: or null.
  void (*expect)(const JointGroup&, const DetectionSums* sums);
  /// calm of all changes; to moved (a lane each): the sum of calm times the changes' squares.
  void (*settle)(const JointGroup&, double* moved);
  /// The weights and curvatures, from trust and variance.
  void (*reweigh)(const JointGroup&);
  /// information and right from the weights. along_ray: the error does not change along the ray of what was
  /// seen, so that a start may be far off.
  void (*evidence)(const JointGroup&, bool along_ray);
  /// evidence, then points, covariance and spread. To moved: the sum of squares of each point's way, over its
  /// variance; change: the variance over that before; failed: not 0 if it is not positive definite.
  void (*posterior)(const JointGroup&, bool along_ray, double* moved, double* failed);
  /// Adds to the covariance that of errors with these deviations (frames, views), alike in all frames.
  void (*add_lasting)(const JointGroup&, const double* deviation, double* failed);
  /// The logarithm of the evidence at the points by Laplace's approximation, up to a constant, to `sum` (a
  /// lane each). It takes the factors' place.
  void (*log_evidence)(const JointGroup&, double* sum, double* failed);
};

/// For tests: no wider kernels than these from now on, unless it is 0. Returns the limit before.
int limit_lanes(int most);

/// Those for the widest vectors of this machine.
const Kernels& kernels(int dim);

}  // namespace asterism::pose_kernels
