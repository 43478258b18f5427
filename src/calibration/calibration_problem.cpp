#include "calibration_problem.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "calibration_checks.hpp"

namespace helix_arm::estimation {
namespace {

// Prior of a direction of the stiffness logs that is held.
constexpr double kHeldDeviation = 1e-4;
// Convergence: the last step lowers the cost by less. A parameter that is off by its standard error
// costs 0.5. With the robust loss, steps may shrink slowly long after they matter.
constexpr double kSettledStep = 1e-4;
constexpr double kParameterTolerance = 1e-10;
constexpr double kGradientTolerance = 1e-10;
// Fraction of the cost; a step that is expected to lower it by less is probably the last.
constexpr double kLastStep = 1e-8;

// Trust region: the damping is the clamped diagonal of J'WJ, in units of the columns' initial
// sizes, over the radius.
constexpr double kFirstRadius = 1e4, kLargestRadius = 1e16, kLeastRadius = 1e-32;
constexpr double kLeastDiagonal = 1e-6, kMostDiagonal = 1e32;
// Least ratio of a step's decrease to the expected one.
constexpr double kLeastDecrease = 1e-3;
constexpr int kMostInvalidSteps = 5;

class TrustRegion {
 public:
  double value() const { return radius_; }
  void accept(double quality) {
    radius_ /= std::max(1.0 / 3, 1 - std::pow(2 * quality - 1, 3));
    radius_ = std::min(radius_, kLargestRadius);
    shrink_ = 2;
  }
  void reject() {
    radius_ /= shrink_;
    shrink_ *= 2;
  }

 private:
  double radius_ = kFirstRadius, shrink_ = 2;
};

bool isFlat(const CalibrationEquations& equations) {
  const Eigen::VectorXd& gradient = equations.gradient();
  return gradient.size() == 0 || gradient.cwiseAbs().maxCoeff() <= kGradientTolerance;
}

struct DampedStep {
  Eigen::VectorXd step;
  double expected;  // decrease of the cost; 0 without a step
};

DampedStep dampedStep(CalibrationEquations& equations, const Eigen::VectorXd& damping) {
  if (!equations.factor(damping)) return {{}, 0};
  const Eigen::VectorXd step = equations.step();
  return {step, 0.5 * (step.dot(damping.cwiseProduct(step)) - step.dot(equations.gradient()))};
}

}  // namespace

CalibrationEquations::CalibrationEquations(const ParameterBlocks& blocks, ParameterBlock eliminated)
    : blocks_(blocks.all()),
      H_(Eigen::MatrixXd::Zero(blocks.columns(), blocks.columns())),
      gradient_(Eigen::VectorXd::Zero(blocks.columns())) {
  for (const ParameterBlocks::Block& block : blocks_) {
    if (block.kind == eliminated) {
      eliminated_.push_back({block.column, block.size()});
      continue;
    }
    for (int i = 0; i < block.size(); ++i) rest_.push_back(block.column + i);
  }
}

void CalibrationEquations::clear() {
  H_.setZero();
  gradient_.setZero();
}

void CalibrationEquations::addPrior(const ParameterBlocks::Block& block,
                                    const Eigen::VectorXd& offset) {
  const Eigen::VectorXd precision = block.deviation.array().square().inverse();
  H_.diagonal().segment(block.column, block.size()) += precision;
  gradient_.segment(block.column, block.size()) += precision.cwiseProduct(offset);
}

void CalibrationEquations::addDirection(const ParameterBlocks::Block& block,
                                        const Eigen::VectorXd& direction, double deviation,
                                        double offset) {
  const double precision = 1 / (deviation * deviation);
  H_.block(block.column, block.column, block.size(), block.size()) +=
      precision * direction * direction.transpose();
  gradient_.segment(block.column, block.size()) += precision * offset * direction;
}

void CalibrationEquations::addTerm(const ReadingCost& cost, const Eigen::MatrixXd& J,
                                   const Eigen::VectorXd& residual, double weight) {
  const Eigen::MatrixXd square = weight * J.transpose() * J;
  const Eigen::VectorXd by_residual = weight * J.transpose() * residual;
  int i = 0;
  for (const int a : cost.blocks()) {
    const ParameterBlocks::Block& row = blocks_[static_cast<std::size_t>(a)];
    gradient_.segment(row.column, row.size()) += by_residual.segment(i, row.size());
    int j = 0;
    for (const int b : cost.blocks()) {
      const ParameterBlocks::Block& column = blocks_[static_cast<std::size_t>(b)];
      H_.block(row.column, column.column, row.size(), column.size()) +=
          square.block(i, j, row.size(), column.size());
      j += column.size();
    }
    i += row.size();
  }
}

bool CalibrationEquations::factor(const Eigen::VectorXd& damping) {
  // Eigen calls NaN a success.
  const auto sound = [](const Cholesky& root) {
    return root.info() == Eigen::Success && root.matrixLLT().diagonal().allFinite();
  };
  reduced_ = H_(rest_, rest_);
  reduced_.diagonal() += damping(rest_);
  reduced_gradient_ = gradient_(rest_);
  for (Eliminated& one : eliminated_) {
    std::vector<int> columns;
    one.at.clear();
    for (std::size_t k = 0; k < rest_.size(); ++k) {
      if (H_.col(rest_[k]).segment(one.column, one.size).isZero(0)) continue;
      one.at.push_back(static_cast<int>(k));
      columns.push_back(rest_[k]);
    }
    const auto rows = H_.middleRows(one.column, one.size);
    Eigen::MatrixXd own = rows.middleCols(one.column, one.size);
    own.diagonal() += damping.segment(one.column, one.size);
    if (!sound(one.root.compute(own))) return false;
    one.scaled_cross = one.root.matrixL().solve(rows(Eigen::all, columns));
    one.scaled_gradient = one.root.matrixL().solve(gradient_.segment(one.column, one.size));
    const Eigen::MatrixXd square = one.scaled_cross.transpose() * one.scaled_cross;
    reduced_(one.at, one.at) -= square;
    reduced_gradient_(one.at) -= one.scaled_cross.transpose() * one.scaled_gradient;
  }
  return sound(root_.compute(reduced_));
}

Eigen::VectorXd CalibrationEquations::step() const {
  Eigen::VectorXd out(gradient_.size());
  const Eigen::VectorXd rest = root_.solve(-reduced_gradient_);
  out(rest_) = rest;
  for (const Eliminated& one : eliminated_) {
    const Eigen::VectorXd scaled = -one.scaled_gradient - one.scaled_cross * rest(one.at);
    out.segment(one.column, one.size) = one.root.matrixU().solve(scaled);
  }
  return out;
}

Eigen::MatrixXd CalibrationEquations::reducedInverse() const {
  return root_.solve(Eigen::MatrixXd::Identity(reduced_.rows(), reduced_.cols()));
}

double CalibrationEquations::inverseTrace(const Eigen::VectorXd& weights) const {
  const Eigen::MatrixXd reduced = reducedInverse();
  double trace = reduced.diagonal().dot(weights(rest_));
  for (const Eliminated& one : eliminated_) {
    const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(one.size, one.size);
    const Eigen::MatrixXd inverse = one.root.matrixU().solve(unit);
    const Eigen::MatrixXd own_reduced = reduced(one.at, one.at);
    const Eigen::MatrixXd variance =
        unit + one.scaled_cross * own_reduced * one.scaled_cross.transpose();
    trace += (inverse * variance * inverse.transpose())
                 .diagonal()
                 .dot(weights.segment(one.column, one.size));
  }
  return trace;
}

CalibrationProblem::CalibrationProblem(const std::vector<ArmCaptures>& arms,
                                       const CalibrationOptions& options)
    : shared_(arms, options), blocks_(arms, options, shared_.model), kind_(kindOf(arms)) {
  auto next_state = static_cast<int>(arms.size());
  for (std::size_t a = 0; a < arms.size(); ++a) {
    for (const Capture& capture : arms[a].captures) {
      places_.push_back(placeAt(shared_, static_cast<int>(a), captures(), capture.pressure));
      if (capture.payload) places_.back().state = next_state++;
    }
  }
  if (options.free_shapes) addShapes();
  for (const ArmCaptures& arm : arms) {
    for (const Capture& capture : arm.captures) {
      costs_.push_back(termsOf(shared_, places_[costs_.size()], capture.reading, blocks_));
    }
  }
  equations_.emplace(blocks_, options.free_shapes ? ParameterBlock::kShape : ParameterBlock::kTag);
  here_.captures.resize(places_.size());
  there_.captures.resize(places_.size());
}

void CalibrationProblem::addShapes() {
  const ModelPrior& prior = shared_.options.model_prior;
  for (const Place& place : places_) {
    // Before there are shapes to fit, the model's.
    shared_.expected_shapes.push_back(
        shared_.model.at(place.state, place.lengths, blocks_.numbers().data()).shape);
    const model::Twists model = shared_.expected_shapes.back().twists();
    Eigen::VectorXd mean(place.entries.size()), deviation(place.entries.size());
    for (std::size_t i = 0; i < place.entries.size(); ++i) {
      mean[i] = model.data()[place.entries[i]];
      deviation[i] = place.entries[i] % 6 < 3 ? prior.translation : prior.rotation;
    }
    blocks_.addShape(place.capture, mean, deviation);
  }
}

void CalibrationProblem::update(Linearisation& at, const Included& included, bool derivatives) {
  const Eigen::VectorXd& numbers = blocks_.numbers();
  if (at.numbers.size() != numbers.size() || at.numbers != numbers) {
    for (LinearisedCapture& one : at.captures) one.known = LinearisedCapture::kNothing;
    at.numbers = numbers;
  }
  const auto wanted = derivatives ? LinearisedCapture::kDerivatives : LinearisedCapture::kResiduals;
  for (std::size_t c = 0; c < at.captures.size(); ++c) {
    if (at.captures[c].known >= wanted || !included(static_cast<int>(c))) continue;
    evaluate(c, derivatives, at.captures[c]);
    at.captures[c].known = wanted;
  }
}

void CalibrationProblem::evaluate(std::size_t capture, bool derivatives, LinearisedCapture& out) {
  out.state = stateAt(shared_, places_[capture], kind_, blocks_, derivatives);
  out.terms.resize(costs_[capture].size());
  for (std::size_t t = 0; t < out.terms.size(); ++t) {
    LinearisedCapture::Term& term = out.terms[t];
    const bool found = out.state.shape.found &&
                       costs_[capture][t]->evaluate(out.state, blocks_, term.residual,
                                                    derivatives ? &term.J : nullptr, by_pieces_);
    term.square = found ? term.residual.squaredNorm() : std::numeric_limits<double>::infinity();
  }
}

CalibrationEquations& CalibrationProblem::equations(double noise_scale, const Included& included) {
  update(here_, included, true);
  assemble({noise_scale, included}, here_);
  return *equations_;
}

double CalibrationProblem::cost(const Task& task, const Linearisation& at) const {
  const double inverse2 = 1 / (task.noise_scale * task.noise_scale);
  double sum = 0;
  for (std::size_t c = 0; c < costs_.size(); ++c) {
    if (!task.included(static_cast<int>(c))) continue;
    const auto& terms = at.captures[c].terms;
    for (std::size_t t = 0; t < terms.size(); ++t) {
      sum += costs_[c][t]->loss(inverse2 * terms[t].square);
    }
  }
  for (const ParameterBlocks::Block& block : blocks_.all()) {
    if (!takesPart(block, task.included)) continue;
    const auto offset = at.numbers.segment(block.column, block.size()) - block.mean;
    sum += offset.cwiseQuotient(block.deviation).squaredNorm();
    if (task.held == nullptr || block.kind != ParameterBlock::kStiffness) continue;
    const auto moved = (at.numbers - start_).segment(block.column, block.size());
    sum += std::pow(task.held->dot(moved) / kHeldDeviation, 2);
  }
  return std::isfinite(sum) ? sum / 2 : std::numeric_limits<double>::quiet_NaN();
}

void CalibrationProblem::assemble(const Task& task, const Linearisation& at) {
  const double inverse2 = 1 / (task.noise_scale * task.noise_scale);
  equations_->clear();
  for (const ParameterBlocks::Block& block : blocks_.all()) {
    if (!takesPart(block, task.included)) continue;
    equations_->addPrior(block, at.numbers.segment(block.column, block.size()) - block.mean);
    if (task.held == nullptr || block.kind != ParameterBlock::kStiffness) continue;
    const Eigen::VectorXd moved = (at.numbers - start_).segment(block.column, block.size());
    equations_->addDirection(block, *task.held, kHeldDeviation, task.held->dot(moved));
  }
  for (std::size_t c = 0; c < costs_.size(); ++c) {
    if (!task.included(static_cast<int>(c))) continue;
    const auto& terms = at.captures[c].terms;
    for (std::size_t t = 0; t < terms.size(); ++t) {
      const double square = inverse2 * terms[t].square;
      if (!std::isfinite(square)) continue;
      const ReadingCost& cost = *costs_[c][t];
      equations_->addTerm(cost, terms[t].J, terms[t].residual, inverse2 * cost.weight(square));
    }
  }
}

Solved CalibrationProblem::solve(double noise_scale, const Included& included,
                                 const Eigen::VectorXd* held, double tolerance) {
  const Task task{noise_scale, included, held};
  start_ = blocks_.numbers();
  update(here_, task.included, true);
  Solved out{false, cost(task, here_)};
  if (std::isnan(out.cost)) return out;
  assemble(task, here_);
  out.converged = isFlat(*equations_);
  const Eigen::ArrayXd unit2 = (1 + equations_->hessian().diagonal().array().sqrt()).square();
  TrustRegion radius;
  int invalid = 0;
  bool settled = false;  // whether the last step was one, and small
  for (int n = 0; !out.converged; ++n) {
    if (n == shared_.options.max_iterations) {
      out.converged = settled;
      break;
    }
    settled = false;
    const Eigen::ArrayXd diagonal = equations_->hessian().diagonal().array();
    const Eigen::VectorXd damping =
        (diagonal / unit2).max(kLeastDiagonal).min(kMostDiagonal) * unit2 / radius.value();
    const auto [step, expected] = dampedStep(*equations_, damping);
    if (!(expected > 0) || !step.allFinite()) {
      if (++invalid >= kMostInvalidSteps) break;
      radius.reject();
      continue;
    }
    invalid = 0;
    if (expected <= tolerance * out.cost) {
      out.converged = true;
      break;
    }
    blocks_.setNumbers(here_.numbers + step);
    const bool derivatives = expected > kLastStep * out.cost;
    update(there_, task.included, derivatives);
    const double cost_there = cost(task, there_);
    const double decrease = out.cost - cost_there;
    const double size = here_.numbers.norm();
    const bool at_end = step.norm() <= kParameterTolerance * (size + kParameterTolerance) ||
                        std::abs(decrease) <= tolerance * out.cost;
    // Without derivatives there, the end is here, where they are known.
    const bool better = decrease > kLeastDecrease * expected && (derivatives || !at_end);
    if (!better) {
      blocks_.setNumbers(here_.numbers);
      radius.reject();
      out.converged = at_end || radius.value() < kLeastRadius;
      continue;
    }
    radius.accept(decrease / expected);
    out.cost = cost_there;
    update(there_, task.included, true);
    std::swap(here_, there_);
    settled = decrease < kSettledStep;
    if (!at_end) assemble(task, here_);
    out.converged = at_end || isFlat(*equations_);
  }
  return out;
}

std::vector<Comparison> CalibrationProblem::compare(double noise_scale, bool errors) {
  update(here_, everyCapture, false);
  std::vector<Comparison> out;
  for (std::size_t c = 0; c < costs_.size(); ++c) {
    const LinearisedCapture& seen = here_.captures[c];
    for (std::size_t t = 0; t < seen.terms.size(); ++t) {
      const ReadingCost& cost = *costs_[c][t];
      const double square = seen.terms[t].square;
      out.push_back({static_cast<int>(c), cost.tag(), cost.residuals(),
                     square / (noise_scale * noise_scale), cost.limit(),
                     errors ? cost.shown(seen.state, blocks_, square) : 0.0});
    }
  }
  return out;
}

Eigen::MatrixXd CalibrationProblem::information(double noise_scale, const Included& included) {
  Eigen::MatrixXd H = equations(noise_scale, included).hessian();
  H.diagonal() -= priorInformation();
  return H;
}

Eigen::MatrixXd CalibrationProblem::expectedInformation(const Eigen::VectorXd& pressure,
                                                        double noise_scale) {
  const Place place = placeAt(shared_, 0, 0, pressure);
  const CaptureState state = stateAt(shared_, place, kind_, blocks_, true);
  if (!state.shape.found) return Eigen::MatrixXd::Zero(blocks_.columns(), blocks_.columns());
  CalibrationEquations expected(blocks_, ParameterBlock::kTag);
  Eigen::MatrixXd by_pieces, J;
  Eigen::VectorXd residual;
  for (const auto& cost : expectedTerms(shared_, place, state, blocks_)) {
    if (!cost->evaluate(state, blocks_, residual, &J, by_pieces)) continue;
    expected.addTerm(*cost, J, residual, 1 / (noise_scale * noise_scale));
  }
  return expected.hessian();
}

Eigen::VectorXd CalibrationProblem::priorInformation() const {
  Eigen::VectorXd out(blocks_.columns());
  for (const ParameterBlocks::Block& block : blocks_.all()) {
    out.segment(block.column, block.size()) = block.deviation.array().square().inverse();
  }
  return out;
}

std::optional<double> CalibrationProblem::K_eps() const {
  const bool fitted = options().fits(FitParameter::kEps) && !options().free_shapes;
  return fitted ? std::optional(elasticity().K_eps) : std::nullopt;
}

Eigen::VectorXd CalibrationProblem::lengthScale() const {
  Eigen::VectorXd out(arms().front().arm.actuatorCount());
  for (int i = 0; i < out.size(); ++i) {
    out[i] = shared_.scaleOf(blocks_.of(ParameterBlock::kLengthScale), i);
  }
  return out;
}

std::optional<ContractionSpline> CalibrationProblem::spline() const {
  if (!isFree(options(), ParameterBlock::kCurve)) return std::nullopt;
  ContractionSpline spline = arms().front().free_curve->spline;
  spline.lengths += spline.root * blocks_.of(ParameterBlock::kCurve);
  return spline;
}

lie::SE3 CalibrationProblem::base() const {
  return lie::SE3::exp(blocks_.motionOf(ParameterBlock::kBase));
}

TagLayout CalibrationProblem::layout() const {
  const ArmCaptures& first = shared_.arms.front();
  TagLayout layout = first.layout;
  for (std::size_t i = 0; i < layout.tags.size(); ++i) {
    const double length = first.arm.restLength(layout.tags[i].section);
    layout.tags[i] = movedBy(layout.tags[i],
                             blocks_.motionOf(ParameterBlock::kTag, static_cast<int>(i)), length);
  }
  return layout;
}

model::Shape CalibrationProblem::shape(int capture) {
  return shapeAt(shared_, places_[capture], blocks_, false).shape;
}

}  // namespace helix_arm::estimation
