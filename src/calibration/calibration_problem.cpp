#include "calibration_problem.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "calibration_checks.hpp"
#include "readings.hpp"

namespace helix_arm::estimation {
CalibrationProblem::CalibrationProblem(const std::vector<ArmCaptures>& arms,
                                       const CalibrationOptions& options,
                                       const Selection& selection)
    : shared_(arms, options, selection),
      blocks_(arms, options, selection, shared_.model),
      kind_(kindOf(firstReading(arms))) {
  for (std::size_t a = 0; a < arms.size(); ++a) {
    for (const Capture& capture : arms[a].captures) {
      places_.push_back(placeAt(shared_, static_cast<int>(a), captures(), capture.pressure));
    }
  }
  if (selection.free_shapes) addShapes();
  std::size_t place = 0;
  for (const ArmCaptures& arm : arms) {
    for (const Capture& capture : arm.captures) {
      for (ReadingTerm& term : termsOf(shared_, places_[place], capture.reading, blocks_)) {
        terms_.push_back(std::move(term));
      }
      ++place;
    }
  }
  descent_.emplace(shared_, kind_, places_, terms_, blocks_);
}

void CalibrationProblem::addShapes() {
  const ModelPrior& prior = shared_.options.model_prior;
  for (const Place& place : places_) {
    // Before there are shapes to fit, the model's.
    shared_.expected_shapes.push_back(
        shared_.model.at(place.arm, place.lengths, values().stiffness.data()).shape);
    const model::Twists model = shared_.expected_shapes.back().twists();
    Eigen::VectorXd mean(place.entries.size()), deviation(place.entries.size());
    for (std::size_t i = 0; i < place.entries.size(); ++i) {
      mean[i] = model.data()[place.entries[i]];
      deviation[i] = place.entries[i] % 6 < 3 ? prior.translation : prior.rotation;
    }
    blocks_.addShape(mean, deviation);
  }
}

Solved CalibrationProblem::solve(double noise_scale, const Included& included,
                                 const Eigen::VectorXd* held, double tolerance) {
  return descent_->solve({noise_scale, included, held, shared_.options.max_iterations, tolerance});
}

std::vector<Comparison> CalibrationProblem::compareSquares(double noise_scale) {
  const LinearisedReadings& readings = descent_->readings(everyCapture, false);
  std::vector<Comparison> out;
  out.reserve(terms_.size());
  for (std::size_t t = 0; t < terms_.size(); ++t) {
    const ReadingTerm& term = terms_[t];
    out.push_back({term.cost->place().capture, term.cost->tag(), term.cost->residuals(),
                   readings.square(t) / (noise_scale * noise_scale), term.limit, 0});
  }
  return out;
}

std::vector<Comparison> CalibrationProblem::compare(double noise_scale) {
  std::vector<Comparison> out = compareSquares(noise_scale);
  const LinearisedReadings& readings = descent_->readings(everyCapture, false);
  for (std::size_t t = 0; t < terms_.size(); ++t) {
    const ReadingCost& cost = *terms_[t].cost;
    out[t].error =
        cost.shown(readings.state(cost.place().capture), blocks_.values(), readings.square(t));
  }
  return out;
}

Eigen::MatrixXd CalibrationProblem::information(double noise_scale, const Included& included) {
  const double inverse2 = 1 / (noise_scale * noise_scale);
  const LinearisedReadings& readings = descent_->readings(included, true);
  const int columns = blocks_.columns();
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(columns, columns);
  for (std::size_t t = 0; t < terms_.size(); ++t) {
    const ReadingTerm& term = terms_[t];
    const double square = inverse2 * readings.square(t);
    if (!included(term.cost->place().capture) || !std::isfinite(square)) continue;
    addInformation(term, blocks_, readings.jacobian(t), inverse2 * term.weight(square), H);
  }
  return H;
}

Eigen::MatrixXd CalibrationProblem::expectedInformation(const Eigen::VectorXd& pressure,
                                                        double noise_scale) {
  const Values& values = blocks_.values();
  const int columns = blocks_.columns();
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(columns, columns);
  const Place place = placeAt(shared_, 0, 0, pressure);
  const CaptureState state = stateAt(shared_, place, kind_, values, true);
  if (!state.shape.found) return H;
  Eigen::MatrixXd by_pieces;
  std::vector<double> residual, J;
  for (const ReadingTerm& term : expectedTerms(shared_, place, state, blocks_)) {
    const ReadingCost& cost = *term.cost;
    residual.resize(static_cast<std::size_t>(cost.residuals()));
    J.resize(static_cast<std::size_t>(cost.residuals() * cost.stride()));
    if (!cost.evaluate(state, values, residual.data(), J.data(), by_pieces)) continue;
    addInformation(term, blocks_, J.data(), 1 / (noise_scale * noise_scale), H);
  }
  return H;
}

Eigen::VectorXd CalibrationProblem::priorInformation() const {
  Eigen::VectorXd out(blocks_.columns());
  for (const ParameterBlocks::Block& block : blocks_.all()) {
    out.segment(block.column, block.size()) = block.deviation.array().square().inverse();
  }
  return out;
}

std::optional<double> CalibrationProblem::K_eps() const {
  const std::vector<StiffnessEntry>& fitted = selection().stiffness;
  if (std::find(fitted.begin(), fitted.end(), StiffnessEntry::kEps) == fitted.end()) {
    return std::nullopt;
  }
  return elasticity().K_eps;
}

Eigen::VectorXd CalibrationProblem::lengthScale() const {
  const Shared& shared = shared_;
  Eigen::VectorXd out(shared.arms.front().arm.actuatorCount());
  for (int i = 0; i < out.size(); ++i) {
    out[i] = shared.scaleOf(values().length_scale, i);
  }
  return out;
}

std::optional<ContractionSpline> CalibrationProblem::spline() const {
  if (!selection().has(ParameterBlock::kCurve)) return std::nullopt;
  ContractionSpline spline = shared_.arms.front().free_curve->spline;
  spline.lengths += spline.root * values().curve;
  return spline;
}

lie::SE3 CalibrationProblem::base() const {
  return lie::SE3::exp(lie::Vector6(values().rig.at(ParameterBlock::kBase)));
}

TagLayout CalibrationProblem::layout() const {
  const ArmCaptures& first = shared_.arms.front();
  TagLayout layout = first.layout;
  for (std::size_t i = 0; i < layout.tags.size(); ++i) {
    const double length = first.arm.restLength(layout.tags[i].section);
    layout.tags[i] = movedBy(layout.tags[i], values().tags[i], length);
  }
  return layout;
}

model::Shape CalibrationProblem::shape(int capture) {
  return shapeAt(shared_, places_[capture], values(), false).shape;
}

}  // namespace helix_arm::estimation
