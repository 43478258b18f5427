#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "helix_arm/estimation/camera.hpp"
#include "helix_arm/estimation/tag_layout.hpp"
#include "helix_arm/model/shape.hpp"

namespace helix_arm::estimation {

/// What one picture says of one tag.
struct CornerObservation {
  int tag;            ///< index in the layout
  Corners direction;  ///< where its corners are seen, undistorted: (x/z, y/z)
};

/// What some other instrument says of one tag.
struct PoseObservation {
  int tag;        ///< index in the layout
  lie::SE3 X_BT;  ///< seen from the arm's nominal base [m]
};

/// A prior of the arm's base about its nominal place: standard deviations about and along each of
/// its axes.
struct BasePrior {
  double translation = 0.002;  ///< [m]
  double rotation = 0.0087;    ///< [rad]
};

/// A prior of each section's twist about the model's: weak, so that it only chooses between shapes
/// that the tags cannot tell apart, and keeps the search among shapes that an arm can have.
struct ModelPrior {
  double translation = 0.2;  ///< standard deviation of each entry of v [m]
  double rotation = 2.0;     ///< of each entry of w [rad]
};

struct TwistFitOptions {
  double corner_noise = 0.3;      ///< expected standard deviation of a corner's coordinate [px]
  double position_noise = 0.010;  ///< of a tag pose's position, each axis [m]
  double rotation_noise = 0.0;    ///< of its rotation, each axis [rad]; 0 leaves rotations out
  /// Tags this many of their expected errors away begin to lose their weight (Cauchy, per tag), and
  /// are outliers. Where the median error is more than 1.5 of the expected one, as with a camera or
  /// placements that are not calibrated, more is expected in proportion, up to 7 times.
  double robust_scale = 3.5;
  ModelPrior model_prior;
  bool planar = false;     ///< the arm bends in its x-y plane: mean v_z, w_x and w_y stay 0
  bool free_base = false;  ///< fit the base as well, under its prior
  BasePrior base_prior;
  bool free_bleed = false;      ///< fit how far white bleeds into black, under its prior
  double bleed_prior = 0.0005;  ///< standard deviation of the bleed [m]
  int max_iterations = 50;      ///< of Levenberg and Marquardt

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

enum class FitStatus {
  kConverged,
  kNotConverged,     ///< the last estimate is given, but it is no minimum
  kUnderdetermined,  ///< the tags say less than twice as much as the model's prior about some entry
  kUnexplained,      ///< no shape fits more than half of the tags
};

/// "converged", "not_converged", "underdetermined" or "unexplained".
const char* nameOf(FitStatus status);

/// How one tag agrees with the fit.
struct TagResidual {
  int tag;        ///< index in the layout
  double rms;     ///< of its corners [px], or distance of its position [m]
  double weight;  ///< that the fit gave it, in (0, 1]
  bool outlier;   ///< it does not fit: farther off than its noise allows
};

/// Shape of an arm fitted to its tags.
struct TwistFit {
  using Covariance = Eigen::MatrixXd;

  FitStatus status = FitStatus::kUnderdetermined;
  model::Twists twists;  ///< (6 x sections) mean twist of each section, v [m], w [rad]
  /// With these mean twists; its pieces deviate from them as the model's do.
  model::Shape shape;
  /// (6 sections)^2 of the twists' errors, [m, rad], so large that the ellipsoid
  /// e' covariance^-1 e <= chi-square_0.95(6 sections) holds the true twists in 95 % of fits.
  ///
  /// Errors of the tags at the scale that their own residuals show (the expected one does not
  /// count), and of the priors as they are stated, each by how it moves the answer. As few tags
  /// know their scale only roughly, the tags' part is larger than a variance by Hotelling's factor,
  /// F over chi-square: 2.0 at 6 residuals beyond those that the parameters take, 1.3 at 18, 1.1
  /// at 60. For single entries that is on the safe side. Where fewer than 4 residuals are left
  /// over, expected ones make up for them: what is said is then as good as the expected noise. It
  /// is linear: where the twists' errors reach some tenths of a radian, fewer than 95 % are held.
  Covariance covariance;
  /// The same of the tip's position seen from the nominal base [m^2], for an ellipsoid of
  /// chi-square_0.95(3); the base's uncertainty, where it is free, is in it.
  Eigen::Matrix3d tip_covariance = Eigen::Matrix3d::Zero();
  lie::SE3 X_B0B;    ///< fitted base seen from its nominal place; identity where fixed
  double bleed = 0;  ///< [m]
  double rms = 0;    ///< over the tags that fit: corners [px], or positions [m]
  double cost = 0;   ///< the robust objective, in units of expected variances
  int iterations = 0;
  std::vector<TagResidual> tags;

  int outliers() const;
};

/// Fits the mean twists of all sections to tags: one robust least squares with an analytic Jacobian
/// (Levenberg and Marquardt).
///
/// How the pieces of a section deviate from its mean, as they do under load, is taken from the
/// model and not fitted: tags are too few to tell.
///
/// Holds its work space: fit() does not allocate once it has seen as many tags. Not for two threads
/// at once.
class TwistFitter {
 public:
  /// @param layout  of the tags; sections of the arm in [1, model::kMaxSections].
  /// @throws std::invalid_argument naming what breaks a rule.
  TwistFitter(TagLayout layout, int sections, const TwistFitOptions& options);
  ~TwistFitter();
  TwistFitter(TwistFitter&&) noexcept;
  TwistFitter& operator=(TwistFitter&&) noexcept;

  const TagLayout& layout() const;
  const TwistFitOptions& options() const;

  /// From a start that is near: the last picture's shape, or the model's.
  ///
  /// @param seen   one entry a tag; none twice, all finite.
  /// @param X_CB   the arm's nominal base seen from the camera.
  /// @param focal  focal length, so that errors are counted in pixels, > 0 [px].
  /// @param start  of as many sections; only its mean twists count.
  /// @param model  what the model's prior is about, and what the pieces take their deviations from;
  ///               the start where left out.
  /// @throws std::invalid_argument naming what breaks a rule.
  const TwistFit& fit(const std::vector<CornerObservation>& seen, const lie::SE3& X_CB,
                      double focal, const model::Shape& start, const model::Shape& model);
  const TwistFit& fit(const std::vector<CornerObservation>& seen, const lie::SE3& X_CB,
                      double focal, const model::Shape& start) {
    return fit(seen, X_CB, focal, start, start);
  }
  const TwistFit& fit(const std::vector<PoseObservation>& seen, const model::Shape& start,
                      const model::Shape& model);
  const TwistFit& fit(const std::vector<PoseObservation>& seen, const model::Shape& start) {
    return fit(seen, start, start);
  }

  /// From the model's shape, which may be far off: tries them, the answers that leave out a tag at
  /// a time, and shapes that are turned to either side, and keeps the least cost over all tags.
  const TwistFit& fitCold(const std::vector<CornerObservation>& seen, const lie::SE3& X_CB,
                          double focal, const model::Shape& model);
  const TwistFit& fitCold(const std::vector<PoseObservation>& seen, const model::Shape& model);

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

/// Covariance of the tip's position (3 x 3) from that of the mean twists alone, base frame [m^2].
Eigen::Matrix3d tipCovariance(const model::Shape& shape, const Eigen::MatrixXd& covariance);

}  // namespace helix_arm::estimation
