#include "helix_arm/localization/body_check.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <functional>
#include <utility>

#include "basics/pi.hpp"
#include "basics/text.hpp"
#include "helix_arm/model/curve.hpp"

namespace helix_arm::estimation {
namespace {

using BodyPoses = std::vector<BodyPose>;

// Distances of a body from where it is expected that need no explanation: shortly after a measured
// shape, and from the model alone, as a share of the arm's length [m, rad].
constexpr double kTurnAfter = 0.15, kPlaceAfter = 0.01;
constexpr double kFarTurn = 0.6, kFarShare = 0.1;
// Share of the squared distances that a mistake must leave at most.
constexpr double kLeftOver = 0.1;
// A body that took another's place is within this of it [m].
constexpr double kTakenPlace = 0.003;
// Motion of the model at a body whose pose does not change, beyond which the body hangs; and where
// other bodies have moved by the second of them [m].
constexpr double kModelMotion = 0.01, kSeenMotion = 0.003;

double angleOf(const Eigen::Matrix3d& R) { return Eigen::AngleAxisd(R).angle(); }

// Distances from the expected poses, relative to those that need no explanation.
struct BodyDistance {
  double largest = 0, squares = 0;
};

class Expectation {
 public:
  Expectation(const ArmView& view, const model::Shape& shape, bool near)
      : view_(view), poses_(tagPoses(view.layout, shape)) {
    for (lie::SE3& pose : poses_) pose = view.X_CB * pose;
    const double length = shape.pieces().topRows<3>().colwise().norm().sum();
    place_ = near ? kPlaceAfter : kFarShare * length;
    turn_ = near ? kTurnAfter : kFarTurn;
  }

  const lie::SE3& of(int body) const { return poses_[static_cast<std::size_t>(body)]; }
  double distance(const BodyPose& one) const {
    return (one.X_CM.translation - of(one.body).translation).norm();
  }
  BodyDistance of(const BodyPoses& seen) const {
    BodyDistance out;
    const auto add = [&out](double relative) {
      out.largest = std::max(out.largest, relative);
      out.squares += relative * relative;
    };
    for (const BodyPose& one : seen) {
      add(distance(one) / place_);
      if (!hasRotation(one)) continue;
      add(angleOf(of(one.body).rotation.transpose() * one.X_CM.rotation) / turn_);
    }
    return out;
  }
  bool hasRotation(const BodyPose& one) const {
    return view_.layout.tags[static_cast<std::size_t>(one.body)].noise->rotation > 0;
  }

 private:
  const ArmView& view_;
  std::vector<lie::SE3> poses_;  // seen from C
  double place_, turn_;
};

// BodyPoses as they would be without a mistake, and its name with the remedy.
struct PoseMistake {
  BodyPoses corrected;
  std::string name;
};

BodyPoses mapped(BodyPoses seen, const std::function<lie::SE3(const lie::SE3&)>& change) {
  for (BodyPose& one : seen) one.X_CM = change(one.X_CM);
  return seen;
}

void addSwaps(const TagLayout& layout, const BodyPoses& seen, std::vector<PoseMistake>& out) {
  for (std::size_t i = 0; i < seen.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      BodyPoses swapped = seen;
      std::swap(swapped[i].X_CM, swapped[j].X_CM);
      const auto label = [&](std::size_t k) {
        return layout.tags[static_cast<std::size_t>(seen[k].body)].label();
      };
      out.push_back({std::move(swapped), "the bodies " + label(j) + " and " + label(i) +
                                             " are swapped: name them anew in the motion-capture "
                                             "system, with patterns of markers that differ"});
    }
  }
}

void addAxisTurns(const BodyPoses& seen, std::vector<PoseMistake>& out) {
  for (const Eigen::Matrix3d& R : axisTurns()) {
    if (R.isIdentity()) continue;
    const Eigen::AngleAxisd turn(R);
    const Eigen::Vector3d axis = turn.axis();
    const std::string name = basics::format(
        "the frame of the poses is turned by %.0f degrees about (%.1f, %.1f, %.1f) against "
        "motion_capture.frame, as with y up in place of z: set the axes of the stream, or "
        "calibrate anew with --fit base",
        turn.angle() * 180 / basics::kPi, axis.x(), axis.y(), axis.z());
    const lie::SE3 X{R.transpose(), Eigen::Vector3d::Zero()}, back{R, Eigen::Vector3d::Zero()};
    out.push_back({mapped(seen, [&X](const lie::SE3& one) { return X * one; }), name});
    out.push_back({mapped(seen, [&](const lie::SE3& one) { return X * one * back; }), name});
  }
}

// The mistake of all poses that explains them; empty if none does.
std::string mistakeOf(const BodyPoses& seen, const ArmView& view, const Expectation& expected) {
  const BodyDistance as_is = expected.of(seen);
  if (as_is.largest <= 1) return {};
  std::vector<PoseMistake> mistakes;
  mistakes.push_back({mapped(seen,
                             [](const lie::SE3& X) {
                               return lie::SE3{X.rotation, 1e-3 * X.translation};
                             }),
                      "the positions are in millimetres: expected metres; let the driver convert"});
  mistakes.push_back({mapped(seen,
                             [](const lie::SE3& X) {
                               return lie::SE3{withScalarFirst(X.rotation), X.translation};
                             }),
                      "the quaternions are w, x, y, z: expected x, y, z, w; correct the driver"});
  addSwaps(view.layout, seen, mistakes);
  addAxisTurns(seen, mistakes);
  const PoseMistake* best = nullptr;
  double least = kLeftOver * as_is.squares;
  for (const PoseMistake& one : mistakes) {
    const BodyDistance left = expected.of(one.corrected);
    if (left.largest > 1 || left.squares >= least) continue;
    least = left.squares;
    best = &one;
  }
  return best != nullptr ? best->name : std::string();
}

// Another body at whose place this one is, although the two are expected elsewhere; null if none.
const BodyPose* takenPlace(const BodyPose& one, const BodyPoses& seen,
                           const Expectation& expected) {
  const auto apart = [](const lie::SE3& a, const lie::SE3& b) {
    return (a.translation - b.translation).norm();
  };
  for (const BodyPose& other : seen) {
    if (other.body == one.body || apart(other.X_CM, one.X_CM) > kTakenPlace) continue;
    if (apart(expected.of(other.body), expected.of(one.body)) < 3 * kTakenPlace) continue;
    if (expected.distance(one) > expected.distance(other)) return &other;
  }
  return nullptr;
}

}  // namespace

Eigen::Matrix3d withScalarFirst(const Eigen::Matrix3d& R) {
  const Eigen::Quaterniond q(R);
  return Eigen::Quaterniond(q.x(), q.y(), q.z(), q.w()).toRotationMatrix();
}

std::vector<Eigen::Matrix3d> axisTurns() {
  std::vector<Eigen::Matrix3d> out;
  for (int x = 0; x < 6; ++x) {
    for (int y = 0; y < 6; ++y) {
      if (x % 3 == y % 3) continue;
      Eigen::Matrix3d& R = out.emplace_back();
      R.col(0) = (x < 3 ? 1 : -1) * Eigen::Vector3d::Unit(x % 3);
      R.col(1) = (y < 3 ? 1 : -1) * Eigen::Vector3d::Unit(y % 3);
      R.col(2) = R.col(0).cross(R.col(1));
    }
  }
  return out;
}

bool BodyCheck::hangs(const BodyPose& one, const BodyPoses& seen,
                      const Eigen::Vector3d& model_place) {
  Track& track = tracks_[static_cast<std::size_t>(one.body)];
  const bool same = track.known && track.pose.translation == one.X_CM.translation &&
                    track.pose.rotation == one.X_CM.rotation;
  if (!same) {
    track = {one.X_CM, model_place, seen, true};
    return false;
  }
  const bool others_moved = std::any_of(seen.begin(), seen.end(), [&](const BodyPose& other) {
    return std::any_of(track.others.begin(), track.others.end(), [&](const BodyPose& then) {
      return then.body == other.body &&
             (then.X_CM.translation - other.X_CM.translation).norm() > kSeenMotion;
    });
  });
  return (model_place - track.model).norm() > (others_moved ? kSeenMotion : kModelMotion);
}

BodyCheck::Verdict BodyCheck::check(const BodyPoses& seen, const model::Shape& expected,
                                    const model::Shape& model, bool near) {
  Verdict out;
  const Expectation places(view_, expected, near);
  const auto label = [this](int body) {
    return view_.layout.tags[static_cast<std::size_t>(body)].label();
  };
  const auto tell = [&out](const std::string& fault) {
    out.fault += (out.fault.empty() ? "" : "; ") + fault;
  };
  for (const BodyPose& one : seen) {
    const TagPlacement& placed = view_.layout.tags[static_cast<std::size_t>(one.body)];
    const Eigen::Vector3d at =
        (model::poseAt(model, placed.section, placed.s) * placed.X_ST).translation;
    if (hangs(one, seen, at)) {
      tell("body " + label(one.body) +
           " hangs: its pose repeats although the arm moves; look for it in the motion-capture "
           "system");
    } else if (const BodyPose* other = takenPlace(one, seen, places)) {
      tell("body " + label(one.body) + " is where " + label(other->body) +
           " is: name them anew in the motion-capture system");
    } else {
      out.sound.push_back(one);
    }
  }
  if (const std::string mistake = mistakeOf(out.sound, view_, places); !mistake.empty()) {
    out.all = true;
    tell(mistake);
  }
  return out;
}

}  // namespace helix_arm::estimation
