#include "camera_calibration.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include <opencv2/calib3d.hpp>

#include "basics/median.hpp"
#include "basics/pi.hpp"
#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/localization/camera_placement.hpp"
#include "helix_arm/model/curve.hpp"

namespace helix_arm::vision {
namespace {

// Both poses X_CT of a tag that fit its corners.
std::vector<lie::SE3> posesOfTag(const estimation::Corners& plane,
                                 const estimation::Corners& direction) {
  std::vector<cv::Point3d> object;
  std::vector<cv::Point2d> picture;
  for (const int c : {3, 2, 1, 0}) {  // the order that OpenCV asks for: from the top left
    object.emplace_back(plane(0, c), plane(1, c), 0.0);
    picture.emplace_back(direction(0, c), direction(1, c));
  }
  std::vector<cv::Mat> rotations, translations;
  try {
    cv::solvePnPGeneric(object, picture, cv::Matx33d::eye(), cv::noArray(), rotations, translations,
                        false, cv::SOLVEPNP_IPPE_SQUARE);
  } catch (const cv::Exception&) {
    return {};  // corners on a line
  }
  std::vector<lie::SE3> poses;
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    cv::Matx33d rotation;
    cv::Rodrigues(rotations[i], rotation);
    lie::SE3 pose;
    pose.rotation = Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rotation.val);
    pose.translation = Eigen::Map<Eigen::Vector3d>(translations[i].ptr<double>());
    if (pose.rotation.allFinite() && pose.translation.allFinite()) poses.push_back(pose);
  }
  return poses;
}

constexpr int kCoefficients = 8;
constexpr int kIntrinsics = 4 + kCoefficients;
constexpr int kPose = 6;
const char* const kNames[kIntrinsics] = {"fx", "fy", "cx", "cy", "k1", "k2",
                                         "p1", "p2", "k3", "k4", "k5", "k6"};
// Views that differ from the others by more than this factor are left out [median RMS].
constexpr double kMostRms = 3.0;
// Below it no view is left out: a sharp picture of a flat board is that good [px].
constexpr double kGoodRms = 0.3;
constexpr double kTilted = 20 * basics::kPi / 180;

// Advice is given below (or above) these.
constexpr double kLeastCoverage = 0.6;
constexpr int kLeastTiltedViews = 4;
constexpr double kWantedFocalError = 0.003;
constexpr double kWantedRms = 0.6;  // [px]

// Input and output of OpenCV for one view.
struct View {
  std::size_t index;  // in the observations
  std::vector<cv::Point3f> board;
  std::vector<cv::Point2f> picture;
  cv::Mat rotation, translation;
};

struct Fit {
  std::vector<View> views;
  cv::Mat K, D;
};

int flagsOf(int coefficients) {
  int flags = coefficients == 8 ? cv::CALIB_RATIONAL_MODEL : 0;
  if (coefficients < 5) flags |= cv::CALIB_FIX_K3;
  if (coefficients < 4) flags |= cv::CALIB_ZERO_TANGENT_DIST;
  if (coefficients < 2) flags |= cv::CALIB_FIX_K1 | cv::CALIB_FIX_K2;
  return flags;
}

View viewOf(const BoardObservation& observation, std::size_t index) {
  View view{index, {}, {}, {}, {}};
  for (const BoardCorner& corner : observation.corners) {
    view.board.emplace_back(static_cast<float>(corner.board.x()),
                            static_cast<float>(corner.board.y()), 0.0F);
    view.picture.emplace_back(static_cast<float>(corner.pixel.x()),
                              static_cast<float>(corner.pixel.y()));
  }
  return view;
}

// A row of chessboard corners gives no pose.
bool areOnOneLine(const BoardObservation& observation) {
  if (observation.corners.empty()) return true;
  Eigen::Matrix2d moments = Eigen::Matrix2d::Zero();
  for (const BoardCorner& corner : observation.corners) {
    const Eigen::Vector2d from_first = corner.board - observation.corners[0].board;
    moments += from_first * from_first.transpose();
  }
  return moments.determinant() <= 1e-6 * moments.trace() * moments.trace();
}

// Why a view cannot be used; empty if it can.
std::string faultOf(const BoardObservation& observation, const BoardParts& parts) {
  const int count = static_cast<int>(observation.corners.size());
  if (count < parts.leastCorners()) {
    return "it shows " + std::to_string(count / parts.corners) + " " + parts.name +
           " of the board; expected " + std::to_string(parts.least);
  }
  return areOnOneLine(observation) ? "all " + parts.name + " that it shows are on one line" : "";
}

// @throws cv::Exception where the views determine no start.
void fit(const cv::Size& size, int coefficients, Fit& out) {
  std::vector<std::vector<cv::Point3f>> board;
  std::vector<std::vector<cv::Point2f>> picture;
  for (const View& view : out.views) {
    board.push_back(view.board);
    picture.push_back(view.picture);
  }
  std::vector<cv::Mat> rotations, translations;
  out.K = cv::Mat::eye(3, 3, CV_64F);
  out.D = cv::Mat::zeros(kCoefficients, 1, CV_64F);
  const cv::TermCriteria until(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 200, 1e-12);
  cv::calibrateCamera(board, picture, size, out.K, out.D, rotations, translations,
                      flagsOf(coefficients), until);
  out.D.resize(kCoefficients, 0.0);
  for (std::size_t i = 0; i < out.views.size(); ++i) {
    rotations[i].convertTo(out.views[i].rotation, CV_64F);
    translations[i].convertTo(out.views[i].translation, CV_64F);
  }
}

// Residuals [px] of a view, and their derivatives by intrinsics and pose.
struct Linearised {
  Eigen::VectorXd residual;
  Eigen::MatrixXd by_intrinsics, by_pose;

  double rms() const {
    return std::sqrt(residual.squaredNorm() / static_cast<double>(residual.size()));
  }
};

Linearised linearise(const Fit& fit, const View& view) {
  std::vector<cv::Point2d> projected;
  std::vector<cv::Point3d> board(view.board.begin(), view.board.end());
  cv::Mat jacobian;  // by rotation, translation, focal lengths, principal point, distortion
  cv::projectPoints(board, view.rotation, view.translation, fit.K, fit.D, projected, jacobian);
  const auto rows = static_cast<Eigen::Index>(2 * projected.size());
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Eigen::Map<const Rows> J(jacobian.ptr<double>(), rows, jacobian.cols);
  Linearised out{Eigen::VectorXd(rows), J.middleCols(kPose, kIntrinsics), J.leftCols(kPose)};
  for (std::size_t i = 0; i < projected.size(); ++i) {
    out.residual.segment<2>(static_cast<Eigen::Index>(2 * i)) << projected[i].x - view.picture[i].x,
        projected[i].y - view.picture[i].y;
  }
  return out;
}

// (intrinsics) standard errors: the larger of the two that CameraParameter describes.
Eigen::VectorXd standardErrors(const std::vector<Linearised>& views, int coefficients) {
  const Eigen::Index count = 4 + coefficients;           // the first ones are fitted
  Eigen::VectorXd scale = Eigen::VectorXd::Zero(count);  // so that their columns are of one size
  for (const Linearised& view : views) {
    scale += view.by_intrinsics.leftCols(count).colwise().squaredNorm().transpose();
  }
  scale = scale.cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(count, count);
  Eigen::MatrixXd shared = Eigen::MatrixXd::Zero(count, count);
  double square = 0;
  Eigen::Index rows = 0;
  for (const Linearised& view : views) {
    Eigen::MatrixXd J = view.by_intrinsics.leftCols(count) * scale.asDiagonal();
    // The part that the pose of the board does not explain.
    const Eigen::MatrixXd& P = view.by_pose;
    J -= P * (P.transpose() * P).ldlt().solve(P.transpose() * J);
    information += J.transpose() * J;
    const Eigen::VectorXd gradient = J.transpose() * view.residual;
    shared += gradient * gradient.transpose();
    square += view.residual.squaredNorm();
    rows += view.residual.size();
  }
  const auto view_count = static_cast<double>(views.size());
  const double freedom = static_cast<double>(rows - count) - kPose * view_count;
  const Eigen::MatrixXd inverse = information.ldlt().solve(Eigen::MatrixXd::Identity(count, count));
  const Eigen::MatrixXd by_views = inverse * shared * inverse * view_count / (view_count - 1);
  Eigen::VectorXd errors = Eigen::VectorXd::Zero(kIntrinsics);
  for (Eigen::Index i = 0; i < count; ++i) {
    const double variance =
        std::max(inverse(i, i) * square / std::max(freedom, 1.0), by_views(i, i));
    errors[i] = scale[i] * std::sqrt(variance);
  }
  return errors;
}

std::string number(double value, int digits) { return basics::format("%.*g", digits, value); }

double reachOf(const Fit& fit, const estimation::Camera& camera) {
  const Eigen::Vector2d centre(camera.cx, camera.cy);
  double farthest = 0, edge = 0;
  for (const View& view : fit.views) {
    for (const cv::Point2f& point : view.picture) {
      farthest = std::max(farthest, (Eigen::Vector2d(point.x, point.y) - centre).norm());
    }
  }
  for (const int x : {0, camera.width - 1}) {
    for (const int y : {0, camera.height - 1}) {
      edge = std::max(edge, (Eigen::Vector2d(x, y) - centre).norm());
    }
  }
  return farthest / edge;
}

// Where the board stood.
void place(const View& view, CalibratedView& out) {
  cv::Matx33d rotation;
  cv::Rodrigues(view.rotation, rotation);
  const cv::Vec3d centre = view.translation;
  out.distance = cv::norm(centre);
  const cv::Vec3d normal(rotation(0, 2), rotation(1, 2), rotation(2, 2));
  out.tilt = std::acos(std::clamp(-normal.dot(centre) / out.distance, -1.0, 1.0));
}

void advise(const Coverage& covered, CameraCalibration& out) {
  if (out.coverage < kLeastCoverage) {
    out.warnings.push_back("the corners cover " + number(100 * out.coverage, 2) +
                           " % of the picture; expected 60 %: hold the board also at the " +
                           covered.emptiest());
  }
  if (out.tilted_views < kLeastTiltedViews) {
    out.warnings.push_back(std::to_string(out.tilted_views) +
                           " views are tilted by 20 degrees or more; expected 4: tilt the board "
                           "to each side, since views from the front alone do not tell the focal "
                           "length from the distance");
  }
  for (const CameraParameter& one : out.parameters) {
    if (one.name[0] != 'f' || one.standard_error <= kWantedFocalError * one.value) continue;
    out.warnings.push_back(one.name + " has a standard error of " +
                           number(100 * one.standard_error / one.value, 2) +
                           " %; expected 0.3 %: add views, close to the camera and tilted");
  }
  if (out.rms > kWantedRms) {
    out.warnings.push_back("the corners' RMS is " + number(out.rms, 2) +
                           " px; expected 0.6 px: glue the board onto something flat, hold it "
                           "still, light it evenly, and lock the focus");
  }
}

// Whether it is known well enough to be used at all.
bool isDetermined(const CameraParameter& one) {
  if (!std::isfinite(one.value) || !std::isfinite(one.standard_error)) return false;
  const bool is_focal = one.name[0] == 'f';
  return !is_focal || (one.value > 0 &&
                       one.standard_error <= CameraCalibrationOptions::kMostFocalError * one.value);
}

void describe(const cv::Size& size, const Fit& fit,
              const std::vector<BoardObservation>& observations,
              const std::vector<Linearised>& residuals, int coefficients, CameraCalibration& out) {
  const cv::Matx33d K = fit.K;
  out.camera = {size.width, size.height, K(0, 0), K(1, 1), K(0, 2), K(1, 2), {}};
  std::copy_n(fit.D.ptr<double>(), kCoefficients, out.camera.distortion.begin());
  const Eigen::VectorXd errors = standardErrors(residuals, coefficients);
  const double values[4] = {out.camera.fx, out.camera.fy, out.camera.cx, out.camera.cy};
  for (int k = 0; k < 4 + std::max(coefficients, 5); ++k) {
    const double value = k < 4 ? values[k] : out.camera.distortion[static_cast<std::size_t>(k - 4)];
    out.parameters.push_back({kNames[k], k < 4 ? "px" : "", value, errors[k]});
  }
  Coverage coverage(size);
  double square = 0, count = 0;
  for (std::size_t i = 0; i < fit.views.size(); ++i) {
    CalibratedView& told = out.views[fit.views[i].index];
    place(fit.views[i], told);
    told.rms = residuals[i].rms();
    out.tilted_views += told.tilt >= kTilted ? 1 : 0;
    coverage.add(observations[fit.views[i].index]);
    square += residuals[i].residual.squaredNorm();
    count += static_cast<double>(residuals[i].residual.size());
  }
  out.rms = std::sqrt(square / count);
  out.coverage = coverage.fraction();
  out.reach = reachOf(fit, out.camera);
  advise(coverage, out);
}

CameraCalibration refused(CameraCalibration out, const std::string& reason) {
  out.reason = reason;
  return out;
}

std::string viewsNeeded(const BoardParts& parts, std::size_t usable, std::size_t pictures) {
  return std::to_string(usable) + " of " + std::to_string(pictures) + " pictures show " +
         std::to_string(parts.least) + " " + parts.name + " of the board or more; expected " +
         std::to_string(CameraCalibrationOptions::kLeastViews) + ": " + parts.remedy;
}

// Leaves out the views that fit much worse than the others. @return whether there were any.
bool leaveOutBadViews(std::vector<View>& views, const std::vector<Linearised>& residuals,
                      std::vector<CalibratedView>& told) {
  std::vector<double> rms;
  for (const Linearised& one : residuals) rms.push_back(one.rms());
  const double limit = std::max(kMostRms * basics::medianOf(rms), kGoodRms);
  std::vector<View> kept;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (rms[i] <= limit) {
      kept.push_back(views[i]);
      continue;
    }
    CalibratedView& view = told[views[i].index];
    view.used = false;
    view.reason = "its RMS of " + number(rms[i], 2) + " px is above " + number(limit, 2) +
                  " px, the larger of 0.3 px and three times the median of all views: the board "
                  "moved or is bent, or a reflection covers it";
  }
  const bool any = kept.size() < views.size();
  if (any) views = std::move(kept);
  return any;
}

}  // namespace

std::optional<lie::SE3> startOfPlacement(const estimation::TagLayout& layout,
                                         const model::Shape& shape,
                                         const std::vector<estimation::CornerObservation>& seen,
                                         double focal) {
  const estimation::Corners plane = layout.corners();
  std::optional<lie::SE3> best;
  double least = std::numeric_limits<double>::infinity();
  for (const estimation::CornerObservation& one : seen) {
    const estimation::TagPlacement& tag = layout.tags[static_cast<std::size_t>(one.tag)];
    const lie::SE3 X_BT = model::poseAt(shape, tag.section, tag.s) * tag.X_ST;
    for (const lie::SE3& X_CT : posesOfTag(plane, one.direction)) {
      const lie::SE3 X_CB = X_CT * X_BT.inverse();
      std::vector<double> errors;
      for (const estimation::CornerObservation& other : seen) {
        errors.push_back(estimation::cornerError(layout, shape, X_CB, other, focal));
      }
      const double median = basics::medianOf(errors);
      if (!(median < least)) continue;
      least = median;
      best = X_CB;
    }
  }
  return best;
}

CameraCalibration calibrateCamera(const BoardParts& parts, const cv::Size& size,
                                  const std::vector<BoardObservation>& observations,
                                  const CameraCalibrationOptions& options) {
  CameraCalibration out;
  Fit best;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const int corners = static_cast<int>(observations[i].corners.size());
    const std::string fault = faultOf(observations[i], parts);
    out.views.push_back(
        {observations[i].name, corners / parts.corners, corners, fault.empty(), fault});
    if (fault.empty()) best.views.push_back(viewOf(observations[i], i));
  }
  if (best.views.size() < static_cast<std::size_t>(options.kLeastViews)) {
    return refused(std::move(out), viewsNeeded(parts, best.views.size(), observations.size()));
  }
  std::vector<Linearised> residuals;
  do {
    if (best.views.size() < static_cast<std::size_t>(options.kLeastViews)) {
      return refused(std::move(out), "the views contradict each other, so that fewer than " +
                                         std::to_string(options.kLeastViews) +
                                         " fit: take the pictures again, with a flat board and "
                                         "a locked focus");
    }
    try {
      fit(size, options.coefficients, best);
    } catch (const cv::Exception&) {
      return refused(std::move(out),
                     "the views determine no focal length: tilt the board to each side");
    }
    residuals.clear();
    for (const View& view : best.views) residuals.push_back(linearise(best, view));
  } while (leaveOutBadViews(best.views, residuals, out.views));

  describe(size, best, observations, residuals, options.coefficients, out);
  for (const CameraParameter& one : out.parameters) {
    if (isDetermined(one)) continue;
    return refused(std::move(out),
                   "the views do not determine " + one.name + ": " + number(one.value, 4) + " +- " +
                       number(one.standard_error, 2) +
                       "; expected a standard error of at most 2 % of a focal length: tilt the "
                       "board to each side, at two distances");
  }
  out.success = true;
  return out;
}

}  // namespace helix_arm::vision
