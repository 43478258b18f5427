#include "helix_arm/statics/workspace_extremes.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <utility>
#include <vector>

#include "box_quadratic.hpp"

namespace helix_arm::statics {
namespace {

constexpr int kCorners = 1024;
constexpr int kLoadedCorners = 128;
constexpr int kExactCorners = 8;
// Number of farthest corners per direction from which the search climbs; the exact tier climbs only
// from the best start.
constexpr int kCornerStarts = 3;
constexpr int kMostSteps = 100;
constexpr int kMostExactSteps = 15;
constexpr double kFirstStep = 0.25;      // of the range of the lengths
constexpr double kLeastFraction = 1e-3;  // of a step
constexpr double kSufficient = 1e-4;     // of the gain that the slope predicts
constexpr double kAtRest = 1e-11;        // gain below which the search ends [m]
constexpr double kLeastCurvature = 0.2;  // Powell's, relative to the present curvature

class Climber {
 public:
  explicit Climber(const ArmModel& model)
      : model_(model),
        n_(model.arm().actuatorCount()),
        exact_(model.choice().setting.tier == Tier::kExact),
        loaded_(takesLoad(model.choice().setting.tier)),
        lower_(n_),
        upper_(n_),
        step_(n_) {
    for (int i = 0; i < n_; ++i) {
      const model::Actuator& actuator = model.arm().actuator(i);
      const double one = actuator.contraction.length(actuator.limits.lower);
      const double other = actuator.contraction.length(actuator.limits.upper);
      lower_[i] = std::min(one, other);
      upper_[i] = std::max(one, other);
    }
  }

  WorkspaceExtremes find(WorkspaceExtremes sampled) {
    WorkspaceExtremes out = std::move(sampled);
    const std::vector<Corner> corners = converged(cornerInputs());
    for (const Corner& corner : corners) out.add(corner.tip, corner.input);
    if (out.empty()) return out;
    for (int which = 0; which < WorkspaceExtremes::kCount; ++which) {
      std::vector<Eigen::VectorXd> starts{out.of(which).input};
      for (const Corner* corner : farthest(corners, which)) starts.push_back(corner->input);
      if (exact_) starts.resize(1);
      for (const Eigen::VectorXd& start : starts) {
        const Eigen::VectorXd input = climb(which, start);
        const Tip tip = model_.tip(input);
        if (tip.converged()) out.add(tip.tip.translation, input);
      }
    }
    return out;
  }

 private:
  struct Corner {
    Eigen::VectorXd input;
    Eigen::Vector3d tip;
  };
  struct Point {
    Eigen::VectorXd lengths, slope;  // slope of the cost
    double cost = std::numeric_limits<double>::infinity();
  };

  std::vector<Eigen::VectorXd> cornerInputs() const {
    const int most = exact_ ? kExactCorners : loaded_ ? kLoadedCorners : kCorners;
    const bool all = n_ < 31 && (1 << n_) <= most;
    const int count = all ? 1 << n_ : most;
    std::mt19937_64 generator(20240229);
    std::vector<Eigen::VectorXd> out;
    for (int corner = 0; corner < count; ++corner) {
      Eigen::VectorXd input(n_);
      for (int i = 0; i < n_; ++i) {
        const model::Range& limits = model_.arm().actuator(i).limits;
        const bool upper = all ? ((corner >> i) & 1) != 0
                               : corner == 1 || (corner > 1 && (generator() >> 63) != 0);
        input[i] = upper ? limits.upper : limits.lower;
      }
      out.push_back(std::move(input));
    }
    return out;
  }

  std::vector<Corner> converged(std::vector<Eigen::VectorXd> inputs) const {
    std::vector<Corner> out;
    for (Eigen::VectorXd& input : inputs) {
      const Tip tip = model_.tip(input);
      if (tip.converged()) out.push_back({std::move(input), tip.tip.translation});
    }
    return out;
  }

  static std::vector<const Corner*> farthest(const std::vector<Corner>& corners, int which) {
    std::vector<const Corner*> out;
    for (const Corner& corner : corners) out.push_back(&corner);
    const auto count = std::min<std::size_t>(out.size(), kCornerStarts);
    std::partial_sort(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(count), out.end(),
                      [which](const Corner* a, const Corner* b) {
                        return WorkspaceExtremes::extent(which, a->tip) >
                               WorkspaceExtremes::extent(which, b->tip);
                      });
    out.resize(count);
    return out;
  }

  void evaluate(int which, Point& point) const {
    const TipResponse response = model_.tipResponse(point.lengths);
    point.cost = std::numeric_limits<double>::infinity();
    if (response.status != SolveStatus::kConverged) return;
    const Eigen::Vector3d& p = response.tip.translation;
    Eigen::Vector3d direction = Eigen::Vector3d::Zero();
    if (which < 6) {
      direction[which % 3] = which < 3 ? -1 : 1;
    } else if (p.norm() > 0) {
      direction = p.normalized();
    }
    point.cost = -WorkspaceExtremes::extent(which, p);
    point.slope = -(response.by_lengths.topRows<3>().transpose() *
                    (response.tip.rotation.transpose() * direction));
  }

  // Climbs to a local maximum of the extent, from inputs within the limits.
  Eigen::VectorXd climb(int which, const Eigen::VectorXd& start) {
    Point point{model_.arm().lengths(start), {}}, next;
    evaluate(which, point);
    if (!std::isfinite(point.cost)) return start;
    const double range = (upper_ - lower_).maxCoeff();
    const double first = std::max(point.slope.norm(), std::numeric_limits<double>::min());
    Eigen::MatrixXd curvature = Eigen::MatrixXd::Identity(n_, n_) * (first / (kFirstStep * range));
    for (int i = 0; i < (exact_ ? kMostExactSteps : kMostSteps); ++i) {
      step_.H = curvature;
      step_.g = point.slope;
      step_.lower = (lower_ - point.lengths).cwiseMin(0);
      step_.upper = (upper_ - point.lengths).cwiseMax(0);
      const Eigen::VectorXd step = step_.solve();
      const double slope = point.slope.dot(step);
      if (!(slope < -kAtRest)) break;
      double fraction = 1;
      for (; fraction > kLeastFraction; fraction *= 0.5) {
        next.lengths = (point.lengths + fraction * step).cwiseMax(lower_).cwiseMin(upper_);
        evaluate(which, next);
        if (next.cost <= point.cost + kSufficient * fraction * slope) break;
      }
      if (!(fraction > kLeastFraction)) break;
      update(next.lengths - point.lengths, next.slope - point.slope, curvature);
      std::swap(point, next);
    }
    return inputsOf(point.lengths, start);
  }

  // BFGS update, damped to stay positive definite (Powell 1978).
  static void update(const Eigen::VectorXd& moved, Eigen::VectorXd turned,
                     Eigen::MatrixXd& curvature) {
    const Eigen::VectorXd expected = curvature * moved;
    const double along = moved.dot(expected);
    if (!(along > 0)) return;
    const double seen = moved.dot(turned);
    if (seen < kLeastCurvature * along) {
      const double share = (1 - kLeastCurvature) * along / (along - seen);
      turned = share * turned + (1 - share) * expected;
    }
    curvature +=
        turned * turned.transpose() / moved.dot(turned) - expected * expected.transpose() / along;
  }

  Eigen::VectorXd inputsOf(const Eigen::VectorXd& lengths, const Eigen::VectorXd& guess) const {
    Eigen::VectorXd input(n_);
    for (int i = 0; i < n_; ++i) {
      const model::Actuator& actuator = model_.arm().actuator(i);
      const model::Range& limits = actuator.limits;
      // A length at its bound maps to exactly the limit.
      if (lengths[i] == actuator.contraction.length(limits.lower)) {
        input[i] = limits.lower;
      } else if (lengths[i] == actuator.contraction.length(limits.upper)) {
        input[i] = limits.upper;
      } else {
        const double q = actuator.contraction.inverseInside(lengths[i], guess[i]);
        input[i] = std::min(std::max(q, limits.lower), limits.upper);
      }
    }
    return input;
  }

  const ArmModel& model_;
  int n_;
  bool exact_, loaded_;
  Eigen::VectorXd lower_, upper_;  // of the lengths [m]
  BoxQuadratic step_;
};

}  // namespace

double WorkspaceExtremes::extent(int which, const Eigen::Vector3d& tip) {
  if (which == 6) return tip.norm();
  return which < 3 ? -tip[which] : tip[which - 3];
}

void WorkspaceExtremes::add(const Eigen::Vector3d& tip, const model::InputRef& input) {
  for (int which = 0; which < kCount; ++which) {
    if (!empty_ && !(extent(which, tip) > extent(which, found_[which].tip))) continue;
    found_[which] = {input, tip};
  }
  empty_ = false;
}

void WorkspaceExtremes::add(const WorkspacePoints& points) {
  if (points.count() == 0) return;
  for (int which = 0; which < kCount; ++which) {
    Eigen::Index row = 0;
    if (which == 6) {
      points.tips.rowwise().squaredNorm().maxCoeff(&row);
    } else if (which < 3) {
      points.tips.col(which).minCoeff(&row);
    } else {
      points.tips.col(which - 3).maxCoeff(&row);
    }
    add(points.tips.row(row).transpose(), points.inputs.row(row).transpose());
  }
}

Eigen::AlignedBox3d WorkspaceExtremes::bounds() const {
  Eigen::AlignedBox3d box;
  for (int which = 0; which < kCount && !empty_; ++which) box.extend(found_[which].tip);
  return box;
}

double WorkspaceExtremes::reach() const { return empty_ ? 0.0 : extent(6, found_[6].tip); }

WorkspaceExtremes findExtremes(const ArmModel& model, WorkspaceExtremes sampled) {
  return Climber(model).find(std::move(sampled));
}

}  // namespace helix_arm::statics
