#include "helix_arm/statics/workspace.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <random>
#include <utility>
#include <vector>

#include "basics/fraction.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/batch.hpp"

namespace helix_arm::statics {
namespace {

// Sizes of pieces: a point takes 20 ns in closed form, up to 0.1 s with sensitivity by the exact
// tier.
constexpr int kBatchPiece = 16384;
constexpr int kClosedFormPiece = 256;
constexpr int kLoadedPiece = 64;
constexpr int kLoadedSensitivityPiece = 8;
constexpr int kExactPiece = 4;
constexpr int kExactSensitivityPiece = 1;

constexpr double kKilopascal = 1e3;   // [Pa]
constexpr double kMillimetre = 1e-3;  // [m]
constexpr double kOnePercentMore = 1.01;

// SplitMix64 (Steele, Lea, Flood 2014): every number of its sequence can be computed directly.
constexpr std::uint64_t kGoldenGamma = 0x9e3779b97f4a7c15;
std::uint64_t mixed(std::uint64_t z) {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
  z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
  return z ^ (z >> 31);
}

// The search for an extreme.
constexpr int kCorners = 1024, kLoadedCorners = 128, kExactCorners = 8;  // of the limits
constexpr std::size_t kStarts = 8, kLoadedStarts = 4, kExactStarts = 1;  // the farthest
constexpr double kFirstStep = 0.25;                                      // of a range
constexpr double kLastStep = 1e-6, kLastLoadedStep = 1e-4, kLastExactStep = 0.05;
constexpr double kLeastGain = 1e-9;  // of a step, in the arm's lengths

/// Searches extremes among corners of the limits and sampled inputs, and from the farthest of these
/// along one input at a time, with steps that are halved where none leads farther.
class ExtremeSearch {
 public:
  ExtremeSearch(const ArmModel& model, const std::function<bool()>& stop)
      : model_(model), arm_(model.arm()), n_(model.arm().actuatorCount()), stop_(stop) {
    if (!takesLoad(model.choice().setting.tier)) return;
    const bool exact = model.choice().setting.tier == Tier::kExact;
    corners_ = exact ? kExactCorners : kLoadedCorners;
    starts_ = exact ? kExactStarts : kLoadedStarts;
    last_step_ = exact ? kLastExactStep : kLastLoadedStep;
  }

  WorkspaceExtremes from(WorkspaceExtremes sampled) const {
    WorkspaceExtremes out = std::move(sampled);
    std::vector<Extreme> candidates = reachedCorners();
    for (int which = 0; which < WorkspaceExtremes::kCount && !out.empty(); ++which) {
      candidates.push_back(out.of(which));
    }
    for (int which = 0; which < WorkspaceExtremes::kCount; ++which) {
      const std::size_t starts = std::min(starts_, candidates.size());
      std::partial_sort(candidates.begin(),
                        candidates.begin() + static_cast<std::ptrdiff_t>(starts), candidates.end(),
                        [which](const Extreme& a, const Extreme& b) {
                          return extent(which, a) > extent(which, b);
                        });
      for (std::size_t i = 0; i < starts; ++i) {
        const Extreme found = farthestFrom(candidates[i], which);
        out.add(found.tip, found.input);
      }
    }
    return out;
  }

 private:
  using Extreme = WorkspaceExtremes::Extreme;

  static double extent(int which, const Extreme& one) {
    return WorkspaceExtremes::extent(which, one.tip);
  }

  // All corners or, if they are many, a selection that includes the lowest and the highest inputs.
  std::vector<Extreme> reachedCorners() const {
    const bool all = n_ < 31 && (1 << n_) <= corners_;
    std::mt19937_64 generator(20240229);
    std::vector<Extreme> out;
    for (int corner = 0; corner < (all ? 1 << n_ : corners_); ++corner) {
      Eigen::VectorXd input(n_);
      for (int i = 0; i < n_; ++i) {
        const bool upper = all ? ((corner >> i) & 1) != 0
                               : corner == 1 || (corner > 1 && (generator() >> 63) != 0);
        input[i] = upper ? arm_.actuator(i).limits.upper : arm_.actuator(i).limits.lower;
      }
      const Tip tip = model_.tip(input);
      if (tip.converged()) out.push_back({std::move(input), tip.tip.translation});
    }
    return out;
  }

  Extreme farthestFrom(Extreme here, int which) const {
    for (double step = kFirstStep; step >= last_step_ && !(stop_ && stop_());) {
      bool farther = false;
      for (int i = 0; i < n_; ++i) {
        const model::Range& limits = arm_.actuator(i).limits;
        for (const double side : {-1.0, 1.0}) {
          Eigen::VectorXd next = here.input;
          next[i] += side * step * (limits.upper - limits.lower);
          next[i] = std::min(std::max(next[i], limits.lower), limits.upper);
          const Tip tip = model_.tip(next);
          if (!tip.converged() || !(WorkspaceExtremes::extent(which, tip.tip.translation) >
                                    extent(which, here) + kLeastGain * arm_.restLength())) {
            continue;
          }
          here = {std::move(next), tip.tip.translation};
          farther = true;
        }
      }
      if (!farther) step *= 0.5;
    }
    return here;
  }

  const ArmModel& model_;
  const model::Arm& arm_;
  int n_;
  const std::function<bool()>& stop_;
  int corners_ = kCorners;
  std::size_t starts_ = kStarts;
  double last_step_ = kLastStep;
};

}  // namespace

Workspace::Workspace(const ArmModel& model, const WorkspaceOptions& options)
    : model_(model), options_(options) {
  batch_ = !takesLoad(model_.choice().setting.tier);
  if (!options_.sensitivity) return;
  for (int i = 0; i < model_.arm().actuatorCount(); ++i) {
    const model::Actuator& actuator = model_.arm().actuator(i);
    basics::require(model::isPressure(actuator.drive), "sensitivity: it is per kPa, and ",
                    actuator.name, " is a tendon; leave it out");
  }
  for (const model::Stiffness& factors : {model::Stiffness{kOnePercentMore, 1.0, 1.0},
                                          {1.0, kOnePercentMore, 1.0},
                                          {1.0, 1.0, kOnePercentMore}}) {
    stiffer_.push_back(model_.scaledStiffness(factors));
  }
  if (!model_.load() || model_.load()->empty()) return;
  stiffer_.push_back(model_.scaledStiffness({1.0, 1.0, 1.0}, kOnePercentMore));
}

int Workspace::pieceSize() const {
  const bool sensitivity = options_.sensitivity;
  if (batch_) return sensitivity ? kClosedFormPiece : kBatchPiece;
  if (model_.choice().setting.tier == Tier::kExact) {
    return sensitivity ? kExactSensitivityPiece : kExactPiece;
  }
  return sensitivity ? kLoadedSensitivityPiece : kLoadedPiece;
}

Eigen::MatrixXd Workspace::drawInputs(std::uint64_t first, int count) const {
  const int n = model_.arm().actuatorCount();
  const std::uint64_t start = mixed(options_.seed + kGoldenGamma);
  Eigen::MatrixXd inputs(count, n);
  for (int i = 0; i < n; ++i) {
    const model::Range& limits = model_.arm().actuator(i).limits;
    for (int row = 0; row < count; ++row) {
      const std::uint64_t place = (first + row) * n + i + 1;
      const double fraction = basics::fractionOf(mixed(start + place * kGoldenGamma));
      // Rounding may exceed the limit.
      inputs(row, i) =
          std::min(limits.lower + fraction * (limits.upper - limits.lower), limits.upper);
    }
  }
  return inputs;
}

Eigen::RowVector3d Workspace::sensitivityAt(const Eigen::VectorXd& q,
                                            const Eigen::Vector3d& tip) const {
  const model::Arm& arm = model_.arm();
  const TipResponse response = model_.tipResponse(arm.lengths(q));
  // Without a derivative, nothing bounds it.
  if (response.status != SolveStatus::kConverged) {
    return Eigen::RowVector3d::Constant(std::numeric_limits<double>::infinity());
  }
  // Not rotated to the base frame, which would not change their lengths.
  const auto moves = response.by.topRows<3>().eval();
  double pressure = 0.0, stiffness = 0.0;
  for (int i = 0; i < q.size(); ++i) {
    pressure += (arm.actuator(i).contraction.slopeInside(q[i]) * moves.col(i)).squaredNorm();
  }
  for (const ArmModel& model : stiffer_) {
    const Tip found = model.tip(q);
    if (!found.converged()) stiffness = std::numeric_limits<double>::infinity();
    stiffness += (found.tip.translation - tip).squaredNorm();
  }
  return {kKilopascal * std::sqrt(pressure), kMillimetre * moves.norm(), std::sqrt(stiffness)};
}

WorkspacePoints Workspace::sample(std::uint64_t first, int count) const {
  WorkspacePoints out;
  out.inputs = drawInputs(first, count);
  out.tips.resize(count, 3);
  if (batch_) {
    std::vector<const double*> columns;
    for (int i = 0; i < out.inputs.cols(); ++i) columns.push_back(out.inputs.col(i).data());
    model::TipBatch(model_.arm())
        .columns(columns.data(), static_cast<std::size_t>(count), out.tips.col(0).data(),
                 out.tips.col(1).data(), out.tips.col(2).data());
    if (!options_.sensitivity) return out;
  }
  if (options_.sensitivity) out.sensitivity.resize(count, kSensitivities);
  int kept = 0;
  for (int row = 0; row < count; ++row) {
    const Eigen::VectorXd q = out.inputs.row(row);
    Eigen::Vector3d tip = out.tips.row(row);
    if (!batch_) {
      const Tip found = model_.tip(q);
      if (!found.converged()) continue;
      tip = found.tip.translation;
    }
    if (options_.sensitivity) {
      const Eigen::RowVector3d sensitivity = sensitivityAt(q, tip);
      if (!sensitivity.allFinite()) continue;
      out.sensitivity.row(kept) = sensitivity;
    }
    out.inputs.row(kept) = q;
    out.tips.row(kept) = tip;
    ++kept;
  }
  out.unbalanced = count - kept;
  out.inputs.conservativeResize(kept, Eigen::NoChange);
  out.tips.conservativeResize(kept, Eigen::NoChange);
  if (options_.sensitivity) out.sensitivity.conservativeResize(kept, Eigen::NoChange);
  return out;
}

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
    const double sign = which < 3 ? -1 : 1;
    Eigen::Index row = 0;
    (which == 6 ? points.tips.rowwise().squaredNorm().eval()
                : (sign * points.tips.col(which % 3)).eval())
        .maxCoeff(&row);
    add(points.tips.row(row).transpose(), points.inputs.row(row).transpose());
  }
}

Eigen::AlignedBox3d WorkspaceExtremes::bounds() const {
  Eigen::AlignedBox3d box;
  for (int which = 0; which < kCount && !empty_; ++which) box.extend(found_[which].tip);
  return box;
}

double WorkspaceExtremes::beyond(const WorkspaceExtremes& sampled) const {
  double out = 0.0;
  for (int which = 0; which < kCount && !empty_ && !sampled.empty_; ++which) {
    out = std::max(out, extent(which, found_[which].tip) - extent(which, sampled.of(which).tip));
  }
  return out;
}

double WorkspaceExtremes::reach() const { return empty_ ? 0.0 : extent(6, found_[6].tip); }

WorkspaceExtremes findExtremes(const ArmModel& model, WorkspaceExtremes sampled,
                               const std::function<bool()>& stop) {
  return ExtremeSearch(model, stop).from(std::move(sampled));
}

}  // namespace helix_arm::statics
