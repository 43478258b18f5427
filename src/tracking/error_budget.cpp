#include "helix_arm/tracking/error_budget.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

#include "helix_arm/model/curve.hpp"

namespace helix_arm::estimation {
namespace {

constexpr double kSlowMotion = 1e4;  // of a pressure; slow contributions hold up to it [Pa]
// A direction with less than this fraction of the largest variance is certain, as across a plane.
constexpr double kLeastShare = 1e-9;
// Chi-square's 99.9 % points for 0 to 3 degrees of freedom.
constexpr std::array<double, 4> kLimits = {0.0, 10.83, 13.82, 16.27};

void set(TipErrorBudget& budget, BudgetPart part, const Eigen::Matrix3d& covariance) {
  budget.parts[static_cast<std::size_t>(part)].covariance = covariance;
}

// Contributions from the covariance of the filter and the model at its state.
void addKnown(const ArmFilter& filter, const ArmFilter::Linearisation& model,
              const model::Shape& shape, const Eigen::VectorXd& variance, TipErrorBudget& budget) {
  const Eigen::MatrixXd &H = model.by_theta, &H_p = model.by_pressure;
  const Eigen::MatrixXd& P = filter.state().covariance;
  const Eigen::Index parameters = H.cols(), biases = H.rows();
  const Eigen::MatrixXd shared = H * P.topRightCorner(parameters, biases);
  const auto tipOf = [&](const Eigen::MatrixXd& measured_rows) {
    const int size = 6 * shape.sectionCount();
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(size, size);
    covariance(filter.rows(), filter.rows()) = measured_rows;
    return tipCovariance(shape, covariance);
  };
  set(budget, BudgetPart::kCalibration,
      tipOf(H * P.topLeftCorner(parameters, parameters) * H.transpose()));
  set(budget, BudgetPart::kUnexplained,
      tipOf(P.bottomRightCorner(biases, biases) + shared + shared.transpose()));
  set(budget, BudgetPart::kPressure, tipOf(H_p * variance.asDiagonal() * H_p.transpose()));
}

Eigen::Matrix3d sumOf(const TipErrorBudget& budget) {
  Eigen::Matrix3d out = Eigen::Matrix3d::Zero();
  for (const BudgetPart part : {BudgetPart::kCalibration, BudgetPart::kUnexplained,
                                BudgetPart::kPressure, BudgetPart::kPlacement}) {
    out += budget.part(part).covariance;
  }
  return out;
}

}  // namespace

const char* nameOf(BudgetPart part) {
  static constexpr std::array<const char*, kBudgetPartCount> kNames = {
      "calibration", "unexplained", "pressure", "placement", "camera"};
  return kNames[static_cast<std::size_t>(part)];
}

const char* nameOf(BudgetState state) {
  return state == BudgetState::kInside ? "inside" : "outside";
}

TipDistance tipDistance(const Eigen::Vector3d& error, const Eigen::Matrix3d& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(covariance);
  const Eigen::Vector3d along = axes.eigenvectors().transpose() * error;
  const double least = kLeastShare * axes.eigenvalues()[2];
  TipDistance out;
  std::size_t degrees = 0;
  for (int i = 0; i < 3; ++i) {
    if (!(axes.eigenvalues()[i] > least)) continue;
    out.squared += along[i] * along[i] / axes.eigenvalues()[i];
    ++degrees;
  }
  out.limit = kLimits[degrees];
  return out;
}

double TipSpread::deviation() const {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(covariance, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, axes.eigenvalues()[2]));
}

ErrorBudget::ErrorBudget(const statics::ArmModel& model, const ArmFilterOptions& options,
                         std::optional<PlacedView> placed)
    : arm_(model.arm()), start_(model, options), placed_(std::move(placed)) {
  if (placed_) placed_->validate();
}

bool ErrorBudget::update(const ArmFilter& filter, const ArmFilter::Input& picture,
                         const std::optional<std::vector<int>>& tags, bool drifts) {
  const auto model = filter.linearise(picture.pressure);
  const auto shape = filter.shape(picture.pressure);
  const auto scene = start_.shape(picture.pressure);
  if (!model || !shape || !scene || !renew(picture.pressure, *shape, tags)) return false;

  TipErrorBudget open;
  addKnown(start_, slow_->scene, *scene, picture.variance, open);
  set(open, BudgetPart::kPlacement, tipCovariance(*scene, slow_->placement));

  TipErrorBudget out;
  out.time = picture.time;
  addKnown(filter, *model, *shape, picture.variance + filter.changeVariance(picture.pressure), out);
  set(out, BudgetPart::kPlacement, tipCovariance(*shape, slow_->placement));
  set(out, BudgetPart::kCamera, tipCovariance(*shape, picture.covariance));
  out.predicted.covariance = sumOf(out);
  out.open_loop.covariance = sumOf(open);
  out.tip = model::tipPose(*shape).translation;
  out.error =
      model::tipPose(scene->about(picture.twists)).translation - model::tipPose(*scene).translation;
  const TipDistance distance =
      tipDistance(out.error, out.open_loop.covariance + out.part(BudgetPart::kCamera).covariance);
  out.distance2 = distance.squared;
  out.limit = distance.limit;
  judge(out, drifts);
  current_ = out;
  return true;
}

bool ErrorBudget::renew(const Eigen::VectorXd& pressure, const model::Shape& shape,
                        const std::optional<std::vector<int>>& tags) {
  std::vector<int> seen;
  if (tags) {
    seen = *tags;
  } else if (placed_) {
    for (const TagImage& placed : visibleTags(placed_->view, shape)) seen.push_back(placed.tag);
  }
  if (slow_ && seen == slow_->tags &&
      (pressure - slow_->pressure).cwiseAbs().maxCoeff() < kSlowMotion) {
    return true;
  }
  auto scene = start_.linearise(pressure);
  if (!scene) return false;
  const int size = 6 * arm_.sectionCount();
  std::optional<Eigen::MatrixXd> placement;
  if (placed_ && !seen.empty()) placement = placementCovariance(*placed_, arm_, shape, seen);
  if (!placement) placement = slow_ ? slow_->placement : Eigen::MatrixXd::Zero(size, size);
  slow_ = {pressure, std::move(seen), std::move(*scene), std::move(*placement)};
  return true;
}

void ErrorBudget::judge(TipErrorBudget& budget, bool drifts) {
  if (drifts) {
    changes_ = 0;
    budget.state = BudgetState::kOutside;
    return;
  }
  const BudgetState before = current_ ? current_->state : BudgetState::kInside;
  const BudgetState seen =
      budget.distance2 > budget.limit ? BudgetState::kOutside : BudgetState::kInside;
  changes_ = seen == before ? 0 : changes_ + 1;
  budget.state = changes_ < kBudgetPatience ? before : seen;
  if (budget.state == seen) changes_ = 0;
}

void ErrorBudget::reset() {
  changes_ = 0;
  current_.reset();
}

}  // namespace helix_arm::estimation
