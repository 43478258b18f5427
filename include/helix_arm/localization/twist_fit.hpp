#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "helix_arm/localization/camera.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/model/shape.hpp"

namespace helix_arm::estimation {

/// Observation of one tag in an image.
struct CornerObservation {
  int tag;            ///< index in the layout
  Corners direction;  ///< undistorted directions of its corners: (x/z, y/z)
};

/// Observation of one tag by another instrument.
struct PoseObservation {
  int tag;        ///< index in the layout
  lie::SE3 X_BT;  ///< seen from the arm's nominal base [m]
};

/// Prior of the arm's base about its nominal pose: standard deviations about and along each of its
/// axes.
struct BasePrior {
  double translation = 0.002;  ///< [m]
  double rotation = 0.0087;    ///< [rad]
};

/// Prior of each section's twist about the model's. It is weak: it selects among shapes that the
/// tags cannot tell apart, and keeps the search within shapes that an arm can have.
struct ModelPrior {
  double translation = 0.2;  ///< standard deviation of each entry of v [m]
  double rotation = 2.0;     ///< of each entry of w [rad]
};

struct TwistFitOptions;

/// Estimate of base and border shift, which stay as they are while the arm moves.
struct RigEstimate {
  using Vector = Eigen::Matrix<double, 7, 1>;
  using Matrix = Eigen::Matrix<double, 7, 7>;

  /// The priors of the options: nominal, with their deviations.
  explicit RigEstimate(const TwistFitOptions& options);

  Vector mean =
      Vector::Zero();  ///< [v; w; border shift]: log of the base seen from the nominal base
  Matrix covariance;   ///< positive definite [m, rad, m]
};

/// Noise that is expected, and what is fitted besides the twists.
struct TwistFitOptions {
  double corner_noise = 0.3;      ///< expected standard deviation of a corner's coordinate [px]
  double position_noise = 0.010;  ///< of a tag pose's position, each axis [m]
  double rotation_noise = 0.0;    ///< of its rotation, each axis [rad]; 0 ignores rotations
  /// Robust threshold in expected standard deviations (Cauchy loss, per tag): beyond it a tag loses
  /// weight and is an outlier. If the median error exceeds 1.5 times the expected one, as with an
  /// uncalibrated camera or placements, the expected noise grows in proportion, up to 7 times.
  double robust_scale = 3.5;
  ModelPrior model_prior;
  bool planar = false;     ///< the arm bends in its x-y plane: mean v_z, w_x and w_y stay 0
  bool free_base = false;  ///< fit the base as well, under its prior
  BasePrior base_prior;
  bool free_border_shift =
      false;  ///< fit the width of white bleeding into black as well, under its prior
  double border_shift_prior = 0.0005;  ///< standard deviation of the border shift [m]
};

/// Whether a shape was fitted.
enum class FitStatus {
  kConverged,
  kNotConverged,     ///< the last estimate is returned, but it is not a minimum
  kUnderdetermined,  ///< for some entry, the tags give less than twice the information of the
                     ///< model's prior
  kUnexplained,      ///< no shape fits more than half of the tags
};

/// "converged", "not_converged", "underdetermined" or "unexplained".
const char* nameOf(FitStatus status);

/// Agreement of one tag with the fit.
struct TagResidual {
  int tag;        ///< index in the layout
  double rms;     ///< of its corners [px], or distance of its position [m]
  double weight;  ///< weight in the fit, in (0, 1]
  bool outlier;   ///< whether its error is larger than its noise allows
};

/// Shape of an arm fitted to its tags.
struct TwistFit {
  using Covariance = Eigen::MatrixXd;

  FitStatus status = FitStatus::kUnderdetermined;
  model::Twists twists;  ///< (6 x sections) mean twist of each section, v [m], w [rad]
  /// The shape with these mean twists; its pieces have the deviations of the model's pieces.
  model::Shape shape;
  /// (6 sections x 6 sections) covariance of the twists' errors, [m, rad], scaled so that the
  /// ellipsoid e' covariance^-1 e <= chi-square_0.95(6 sections) contains the true twists in 95 %
  /// of fits.
  ///
  /// It includes the errors of the tags, scaled by their residuals (the expected scale has no
  /// influence), and the errors of the priors as stated, each propagated to the result. Few tags
  /// determine their scale only roughly, so the tags' part is larger than a variance by Hotelling's
  /// factor, F over chi-square: 2.0 at 6 residuals in excess of the fitted parameters, 1.3 at 18,
  /// 1.1 at 60. For single entries this is conservative. With fewer than 4 excess residuals,
  /// expected ones are added; the result is then as good as the expected noise. The propagation is
  /// linear: if the twists' errors reach some tenths of a radian, the ellipsoid contains somewhat
  /// fewer than 95 %.
  Covariance covariance;
  /// Likewise for the tip's position seen from the nominal base [m^2], for an ellipsoid of
  /// chi-square_0.95(3). Includes the uncertainty of a free base, and how the tip's path bends
  /// within the errors of the twists.
  Eigen::Matrix3d tip_covariance = Eigen::Matrix3d::Zero();
  /// Base and border shift with what these tags tell of them, in addition to what was known.
  /// Entries that the options do not free are as known.
  RigEstimate rig{TwistFitOptions()};
  lie::SE3 X_B0B;           ///< fitted base seen from the nominal base; identity if fixed
  double border_shift = 0;  ///< [m]
  double rms = 0;           ///< over the tags that fit: corners [px] or positions [m]
  double cost = 0;          ///< robust objective, in units of expected variances
  int iterations = 0;
  std::vector<TagResidual> tags;

  int outliers() const;
};

/// Fits the mean twists of all sections to tag observations, by one robust least-squares problem
/// with an analytic Jacobian (Levenberg-Marquardt).
///
/// The deviations of a section's pieces from their mean, which a load causes, are taken from the
/// model and not fitted: the tags are too few to determine them.
///
/// Owns its workspace: fit() does not allocate once it has seen as many tags. Not thread-safe.
class TwistFitter {
 public:
  /// @param layout    placements of the tags.
  /// @param sections  number of sections of the arm, in [1, model::kMaxSections].
  TwistFitter(TagLayout layout, int sections, const TwistFitOptions& options);
  ~TwistFitter();
  TwistFitter(TwistFitter&&) noexcept;
  TwistFitter& operator=(TwistFitter&&) noexcept;

  const TagLayout& layout() const;
  const TwistFitOptions& options() const;

  /// Sets the estimate of base and border shift before the next fits, instead of the priors of the
  /// options.
  /// @throws std::invalid_argument if it is not finite or its covariance not positive definite.
  void know(const RigEstimate& rig);

  /// Fit from a start near the solution: the shape of the last image, or the model's.
  ///
  /// @param seen   one entry per tag, no tag twice, all finite.
  /// @param X_CB   the arm's nominal base seen from the camera.
  /// @param focal  focal length, which converts errors to pixels, > 0 [px].
  /// @param start  shape with the same number of sections; only its mean twists are used.
  /// @param model  centre of the model's prior and source of the pieces' deviations; default: the
  ///     start.
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

  /// Fit from the model's shape, which may be far from the solution. Tries that shape, the
  /// solutions that omit one tag at a time, and shapes turned to either side, and keeps the one
  /// with the lowest cost over all tags.
  const TwistFit& fitCold(const std::vector<CornerObservation>& seen, const lie::SE3& X_CB,
                          double focal, const model::Shape& model);
  const TwistFit& fitCold(const std::vector<PoseObservation>& seen, const model::Shape& model);

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

/// Covariance of the tip's position (3 x 3) due to that of the mean twists alone, base frame [m^2].
Eigen::Matrix3d tipCovariance(const model::Shape& shape, const Eigen::MatrixXd& covariance);

}  // namespace helix_arm::estimation
