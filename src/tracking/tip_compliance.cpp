#include "helix_arm/tracking/tip_compliance.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <type_traits>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "localization/twist_equations.hpp"

namespace helix_arm::estimation {
namespace {

constexpr double kForceStep = 0.25 / TipCompliance::kTypicalStiffness;  // of differences, per K_eps
constexpr double kPressureMove = 1e4;  // beyond it the compliance is computed again [Pa]
constexpr int kPlacesPerSection = 4;
constexpr int kMostPlacedSections = 4;  // more have too many positions to compare
constexpr double kNoOutliers = 1e6;     // robust scale without outlier rejection

statics::Load loadOf(const statics::ArmModel& model) {
  if (model.load()) return *model.load();
  const auto sections = static_cast<std::size_t>(model.arm().sectionCount());
  statics::Load load;
  load.mass.assign(sections, 0.0);
  load.K_eps.assign(sections, TipCompliance::kTypicalStiffness);
  return load;
}

std::vector<ForcePlace> placesOn(const statics::ArmModel& model) {
  const int sections = model.arm().sectionCount();
  const bool only_tip =
      sections > kMostPlacedSections || loadOf(model).innerPlaces() >= statics::kMaxInnerPoints;
  if (only_tip) return {{sections - 1, 1.0}};
  std::vector<ForcePlace> out;
  for (int k = 0; k < sections; ++k) {
    for (int i = 1; i <= kPlacesPerSection; ++i) {
      out.push_back({k, static_cast<double>(i) / kPlacesPerSection});
    }
  }
  return out;
}

// The fit of some tags, linear about a shape that they measure exactly.
class LinearFit {
 public:
  LinearFit(const ArmView& view, TwistFitOptions options) : view_(view), options_(options) {
    options_.robust_scale = kNoOutliers;
    equations_.emplace(view_.layout, view_.sections, options_);
  }

  // False if the tags do not determine the shape.
  bool lineariseAt(const model::Shape& shape, const std::optional<std::vector<int>>& tags) {
    tags_ = tags.value_or(std::vector<int>());
    if (!tags) {
      for (const TagImage& placed : visibleTags(view_, shape)) tags_.push_back(placed.tag);
    }
    equations_->expect(shape);
    equations_->start(shape.twists(), point_);
    const auto hessian = evaluate(shape);
    if (!hessian) return false;
    factors_.compute(*hessian);
    return factors_.info() == Eigen::Success;
  }

  // Fitted mean twists of another shape minus those of the linearised one; absent if a corner is
  // behind the camera.
  std::optional<Eigen::VectorXd> change(const model::Shape& shape) {
    if (!evaluate(shape)) return std::nullopt;
    return Eigen::VectorXd(-factors_.solve(system_.gradient)).head(6 * view_.sections);
  }

 private:
  std::optional<Eigen::MatrixXd> evaluate(const model::Shape& shape) {
    withInstrument(view_, options_, [&](const auto& instrument, const auto& observe) {
      std::vector<typename std::decay_t<decltype(instrument)>::Observation> seen;
      for (const int tag : tags_) seen.push_back(observe(shape, tag));
      equations_->evaluate(instrument, seen, -1, point_, system_);
    });
    if (!std::isfinite(point_.cost)) return std::nullopt;
    return system_.hessian;
  }

  const ArmView view_;
  TwistFitOptions options_;
  std::optional<TwistEquations> equations_;
  std::vector<int> tags_;
  FitPoint point_;
  NormalEquations system_;
  Eigen::LLT<Eigen::MatrixXd> factors_;
};

}  // namespace

struct TipCompliance::Workspace {
  explicit Workspace(const statics::ArmModel& given)
      : load(loadOf(given)),
        normalised(!given.load()),
        stiffness(*std::min_element(load.K_eps.begin(), load.K_eps.end())),
        places(placesOn(given)),
        order(std::max(statics::kLeastOrder, given.choice().setting.order)),
        corrected(given),
        computed(places.size()) {}

  struct Compliance {
    Eigen::MatrixXd of_fit;  // (6 sections x 3) of the fitted twists
    Eigen::Matrix3d beyond;  // of the tip, less that of the tip of the fitted twists
    bool complete;           // a shape balances a force along every axis
  };

  std::optional<model::Shape> shapeUnder(const statics::Load& with) const {
    const model::Arm& arm = corrected.arm();
    const Eigen::VectorXd lengths = corrected.scaled(arm.lengths(pressure));
    const statics::Solution solution =
        statics::LoadedArm(arm, with, order)
            .solve(statics::unloadedUnderOfLengths(arm, with, lengths));
    if (!solution.converged()) return std::nullopt;
    return solution.shape.about(solution.shape.twists() + corrected.correction().offset);
  }

  Compliance compute(const ForcePlace& place) {
    Compliance out{Eigen::MatrixXd::Zero(6 * corrected.arm().sectionCount(), 3),
                   Eigen::Matrix3d::Zero(), false};
    statics::Load with = load;
    for (double& K_eps : with.K_eps) K_eps *= corrected.correction().K_eps_factor;
    if (!unforced) {
      unforced = shapeUnder(with);
      fits = unforced && fit && fit->lineariseAt(*unforced, tags);
    }
    if (!unforced || (fit && !fits)) return out;
    const double step = kForceStep * corrected.correction().K_eps_factor * stiffness;
    out.complete = true;
    with.points.push_back({});
    with.points.back().section = place.section;
    with.points.back().s = place.s;
    const int last = corrected.arm().sectionCount() - 1;
    if (place.section == last && place.s == 1.0) {
      with.points.back().offset = corrected.arm().link(last).translation;
    }
    // Tip of the shape whose mean twists are these.
    const auto tipOf = [this](const Eigen::VectorXd& change) {
      model::Twists twists = unforced->twists();
      twists.reshaped() += change;
      return model::tipPose(unforced->about(twists)).translation;
    };
    for (int axis = 0; axis < 3; ++axis) {
      std::optional<Eigen::VectorXd> ends[2];
      Eigen::Vector3d beyond[2];
      for (const int side : {0, 1}) {
        with.points.back().force = (side == 0 ? -step : step) * Eigen::Vector3d::Unit(axis);
        const auto shape = shapeUnder(with);
        if (!shape) continue;
        ends[side] = fit ? fit->change(*shape)
                         : Eigen::VectorXd((shape->twists() - unforced->twists()).reshaped());
        beyond[side] =
            fit && ends[side]
                ? Eigen::Vector3d(model::tipPose(*shape).translation - tipOf(*ends[side]))
                : Eigen::Vector3d::Zero();
      }
      if (!ends[0] || !ends[1]) {
        out.complete = false;
        continue;
      }
      out.of_fit.col(axis) = (*ends[1] - *ends[0]) / (2 * step);
      out.beyond.col(axis) = (beyond[1] - beyond[0]) / (2 * step);
    }
    return out;
  }

  const Compliance& at(std::size_t place) {
    auto& one = computed.at(place);
    if (!one) one = compute(places[place]);
    return *one;
  }

  const statics::Load load;  // with nominal K_eps
  const bool normalised;
  const double stiffness;  // least nominal K_eps [N]
  const std::vector<ForcePlace> places;
  const int order;  // that of the model, else a soft arm may find no balance
  statics::CorrectedModel corrected;
  std::optional<LinearFit> fit;

  Eigen::VectorXd pressure;
  std::optional<std::vector<int>> tags;
  std::optional<model::Shape> unforced;
  bool fits = false;
  std::vector<std::optional<Compliance>> computed;  // per position
};

TipCompliance::TipCompliance(const statics::ArmModel& model)
    : work_(std::make_unique<Workspace>(model)) {}
TipCompliance::TipCompliance(const statics::ArmModel& model, const ArmView& view,
                             const TwistFitOptions& fit)
    : TipCompliance(model) {
  work_->fit.emplace(view, fit);
}
TipCompliance::~TipCompliance() = default;
TipCompliance::TipCompliance(TipCompliance&&) noexcept = default;
TipCompliance& TipCompliance::operator=(TipCompliance&&) noexcept = default;

bool TipCompliance::normalised() const { return work_->normalised; }
double TipCompliance::stiffness() const { return work_->stiffness; }
const std::vector<ForcePlace>& TipCompliance::places() const { return work_->places; }

void TipCompliance::moveTo(const Eigen::VectorXd& pressure, const statics::Correction& correction,
                           const std::optional<std::vector<int>>& tags) {
  Workspace& w = *work_;
  const Eigen::VectorXd inside = w.corrected.arm().clamped(pressure);
  const bool stays = w.pressure.size() == inside.size() && tags == w.tags &&
                     (inside - w.pressure).cwiseAbs().maxCoeff() < kPressureMove;
  if (stays) return;
  w.pressure = inside;
  w.tags = tags;
  w.corrected.set(correction);
  w.unforced.reset();
  for (auto& computed : w.computed) computed.reset();
}

const Eigen::MatrixXd& TipCompliance::at(std::size_t place) { return work_->at(place).of_fit; }

const Eigen::Matrix3d& TipCompliance::tipBeyondFit(std::size_t place) {
  return work_->at(place).beyond;
}

bool TipCompliance::complete() { return work_->at(places().size() - 1).complete; }

}  // namespace helix_arm::estimation
