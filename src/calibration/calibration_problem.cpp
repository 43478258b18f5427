#include "calibration_problem.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "calibration_checks.hpp"
#include "readings.hpp"

namespace helix_arm::estimation {
struct CalibrationProblem::Workspace {
  Shared shared;
  ParameterBlocks blocks;
  ReadingKind kind;
  std::vector<Place> places;  // (captures)
  std::vector<ReadingTerm> terms;
  std::optional<CalibrationDescent> descent;

  Workspace(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options,
            const Selection& selection)
      : shared(arms, options, selection),
        blocks(arms, options, selection, shared.model),
        kind(kindOf(firstReading(arms))) {
    for (std::size_t a = 0; a < arms.size(); ++a) {
      for (const Capture& capture : arms[a].captures) {
        places.push_back(placeAt(shared, static_cast<int>(a), static_cast<int>(places.size()),
                                 capture.pressure));
      }
    }
    if (selection.free_shapes) addShapes();
    std::size_t place = 0;
    for (const ArmCaptures& arm : arms) {
      for (const Capture& capture : arm.captures) {
        for (ReadingTerm& term : termsOf(shared, places[place], capture.reading, blocks)) {
          terms.push_back(std::move(term));
        }
        ++place;
      }
    }
    descent.emplace(shared, kind, places, terms, blocks);
  }

  void addShapes() {
    const ModelPrior& prior = shared.options.model_prior;
    for (const Place& place : places) {
      // Before there are shapes to fit, the model's.
      shared.expected_shapes.push_back(
          shared.model.at(place.arm, place.lengths, blocks.values().stiffness.data()).shape);
      const model::Twists model = shared.expected_shapes.back().twists();
      Eigen::VectorXd mean(place.entries.size()), deviation(place.entries.size());
      for (std::size_t i = 0; i < place.entries.size(); ++i) {
        mean[i] = model.data()[place.entries[i]];
        deviation[i] = place.entries[i] % 6 < 3 ? prior.translation : prior.rotation;
      }
      blocks.addShape(mean, deviation);
    }
  }

  Elasticity elasticity() const {
    return shared.model.elasticityAt(blocks.values().stiffness.data(), shared.model.initial());
  }
};

CalibrationProblem::CalibrationProblem(const std::vector<ArmCaptures>& arms,
                                       const CalibrationOptions& options,
                                       const Selection& selection)
    : work_(std::make_unique<Workspace>(arms, options, selection)) {}
CalibrationProblem::~CalibrationProblem() = default;

const Selection& CalibrationProblem::selection() const { return work().shared.selection; }
int CalibrationProblem::captures() const { return static_cast<int>(work().places.size()); }
int CalibrationProblem::armOf(int capture) const { return work().places[capture].arm; }
const std::vector<ParameterInfo>& CalibrationProblem::parameters() const {
  return work().blocks.infos();
}
const Values& CalibrationProblem::values() const { return work().blocks.values(); }
Values& CalibrationProblem::values() { return work().blocks.values(); }
Eigen::VectorXd CalibrationProblem::vector() const { return work().blocks.vector(); }

Solved CalibrationProblem::solve(double noise_scale, const Included& included,
                                 const Eigen::VectorXd* held, double tolerance) {
  return work().descent->solve(
      {noise_scale, included, held, work().shared.options.max_iterations, tolerance});
}

std::vector<Comparison> CalibrationProblem::compareSquares(double noise_scale) {
  Workspace& work = this->work();
  const LinearisedReadings& readings = work.descent->readings(everyCapture, false);
  std::vector<Comparison> out;
  out.reserve(work.terms.size());
  for (std::size_t t = 0; t < work.terms.size(); ++t) {
    const ReadingTerm& term = work.terms[t];
    out.push_back({term.cost->place().capture, term.cost->tag(), term.cost->residuals(),
                   readings.square(t) / (noise_scale * noise_scale), term.limit, 0});
  }
  return out;
}

std::vector<Comparison> CalibrationProblem::compare(double noise_scale) {
  Workspace& work = this->work();
  std::vector<Comparison> out = compareSquares(noise_scale);
  const LinearisedReadings& readings = work.descent->readings(everyCapture, false);
  for (std::size_t t = 0; t < work.terms.size(); ++t) {
    const ReadingCost& cost = *work.terms[t].cost;
    out[t].error =
        cost.shown(readings.state(cost.place().capture), work.blocks.values(), readings.square(t));
  }
  return out;
}

ArrowEquations& CalibrationProblem::equations(double noise_scale) {
  return work().descent->equations(noise_scale, everyCapture);
}

Eigen::MatrixXd CalibrationProblem::information(double noise_scale, const Included& included) {
  Workspace& work = this->work();
  const double inverse2 = 1 / (noise_scale * noise_scale);
  const LinearisedReadings& readings = work.descent->readings(included, true);
  const int columns = work.blocks.columns();
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(columns, columns);
  for (std::size_t t = 0; t < work.terms.size(); ++t) {
    const ReadingTerm& term = work.terms[t];
    const double square = inverse2 * readings.square(t);
    if (!included(term.cost->place().capture) || !std::isfinite(square)) continue;
    addInformation(term, work.blocks, readings.jacobian(t), inverse2 * term.weight(square), H);
  }
  return H;
}

Eigen::MatrixXd CalibrationProblem::expectedInformation(const Eigen::VectorXd& pressure,
                                                        double noise_scale) {
  Workspace& work = this->work();
  const Values& values = work.blocks.values();
  const int columns = work.blocks.columns();
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(columns, columns);
  const Place place = placeAt(work.shared, 0, 0, pressure);
  const CaptureState state = stateAt(work.shared, place, work.kind, values, true);
  if (!state.shape.found) return H;
  Eigen::MatrixXd by_pieces;
  std::vector<double> residual, J;
  for (const ReadingTerm& term : expectedTerms(work.shared, place, state, work.blocks)) {
    const ReadingCost& cost = *term.cost;
    residual.resize(static_cast<std::size_t>(cost.residuals()));
    J.resize(static_cast<std::size_t>(cost.residuals() * cost.stride()));
    if (!cost.evaluate(state, values, residual.data(), J.data(), by_pieces)) continue;
    addInformation(term, work.blocks, J.data(), 1 / (noise_scale * noise_scale), H);
  }
  return H;
}

Eigen::VectorXd CalibrationProblem::priorInformation() const {
  Eigen::VectorXd out(work().blocks.columns());
  for (const ParameterBlocks::Block& block : work().blocks.all()) {
    out.segment(block.column, block.size()) = block.deviation.array().square().inverse();
  }
  return out;
}

model::Stiffness CalibrationProblem::stiffness() const { return work().elasticity().ratios; }

std::optional<double> CalibrationProblem::K_eps() const {
  const std::vector<StiffnessEntry>& fitted = selection().stiffness;
  if (std::find(fitted.begin(), fitted.end(), StiffnessEntry::kEps) == fitted.end()) {
    return std::nullopt;
  }
  return work().elasticity().K_eps;
}

Eigen::VectorXd CalibrationProblem::lengthScale() const {
  const Shared& shared = work().shared;
  Eigen::VectorXd out(shared.arms.front().arm.actuatorCount());
  for (int i = 0; i < out.size(); ++i) {
    out[i] = shared.scaleOf(values().length_scale, i);
  }
  return out;
}

std::optional<ContractionSpline> CalibrationProblem::spline() const {
  if (!selection().has(ParameterBlock::kCurve)) return std::nullopt;
  ContractionSpline spline = work().shared.arms.front().free_curve->spline;
  spline.lengths += spline.root * values().curve;
  return spline;
}

void CalibrationProblem::loosenCurve(double factor) { work().blocks.loosenCurve(factor); }

lie::SE3 CalibrationProblem::base() const {
  return lie::SE3::exp(lie::Vector6(values().rig.at(ParameterBlock::kBase)));
}

TagLayout CalibrationProblem::layout() const {
  const ArmCaptures& first = work().shared.arms.front();
  TagLayout layout = first.layout;
  for (std::size_t i = 0; i < layout.tags.size(); ++i) {
    const double length = first.arm.restLength(layout.tags[i].section);
    layout.tags[i] = movedBy(layout.tags[i], values().tags[i], length);
  }
  return layout;
}

model::Shape CalibrationProblem::shape(int capture) {
  return shapeAt(work().shared, work().places[capture], values(), false).shape;
}

}  // namespace helix_arm::estimation
