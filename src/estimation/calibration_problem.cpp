#include "calibration_problem.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

#include "reading_costs.hpp"
#include "reading_terms.hpp"

namespace helix_arm::estimation {
namespace {

// Prior of a direction of the stiffness logs that is held: Ceres 1 and 2 have no common way to fix
// part of a block.
constexpr double kHeldDeviation = 1e-4;
// Convergence: the last step lowers the cost by less. A parameter that is off by its standard error
// costs 0.5. With the robust loss, steps may shrink slowly long after they matter.
constexpr double kSettledStep = 1e-4;

bool isAtItsEnd(const ceres::Solver::Summary& summary) {
  if (summary.termination_type == ceres::CONVERGENCE) return true;
  const ceres::IterationSummary& last = summary.iterations.back();
  return summary.termination_type == ceres::NO_CONVERGENCE && last.step_is_successful &&
         last.cost_change < kSettledStep;
}

}  // namespace

struct CalibrationProblem::Workspace {
  Shared shared;
  ParameterBlocks blocks;
  std::vector<ReadingTerm> terms;
  std::vector<std::pair<int, int>> places;  // arm and index of each capture

  Workspace(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options,
            const Selection& selection)
      : shared(arms, options, selection), blocks(arms, options, selection, shared.model) {
    for (std::size_t a = 0; a < arms.size(); ++a) {
      for (std::size_t c = 0; c < arms[a].captures.size(); ++c) {
        places.emplace_back(static_cast<int>(a), static_cast<int>(c));
      }
    }
    if (selection.free_shapes) addShapes();
    for (int c = 0; c < static_cast<int>(places.size()); ++c) addTerms(c);
  }

  const ArmCaptures& armOf(int capture) const { return shared.arms[places[capture].first]; }
  const Capture& captureOf(int capture) const {
    return armOf(capture).captures[places[capture].second];
  }

  void addShapes() {
    const ModelPrior& prior = shared.options.model_prior;
    for (int c = 0; c < static_cast<int>(places.size()); ++c) {
      const std::vector<int> entries = freeEntries(armOf(c));
      shared.expected_shapes.push_back(modelShape(c));
      const model::Twists model = shared.expected_shapes.back().twists();
      Eigen::VectorXd mean(entries.size()), deviation(entries.size());
      for (std::size_t i = 0; i < entries.size(); ++i) {
        mean[i] = model.data()[entries[i]];
        deviation[i] = entries[i] % 6 < 3 ? prior.translation : prior.rotation;
      }
      blocks.addShape(mean, deviation);
    }
  }

  void addTerms(int capture) {
    const Capture& measured = captureOf(capture);
    const Place place = placeAt(shared, places[capture].first, capture, measured.pressure);
    for (ReadingTerm& term : termsOf(shared, place, measured.reading, blocks)) {
      terms.push_back(std::move(term));
    }
  }

  model::Shape freeShape(int capture) const {
    model::Twists twists(6, armOf(capture).arm.sectionCount());
    twists.setZero();
    const std::vector<int> entries = freeEntries(armOf(capture));
    for (std::size_t i = 0; i < entries.size(); ++i) {
      twists.data()[entries[i]] = blocks.values().shapes[capture][static_cast<Eigen::Index>(i)];
    }
    return shared.expected_shapes[capture].about(twists);
  }

  model::Shape modelShape(int capture) {
    const Values& values = blocks.values();
    const Place place =
        placeAt(shared, places[capture].first, capture, captureOf(capture).pressure);
    Eigen::VectorXd lengths = place.lengthsAt(values.curve.data());
    for (int i = 0; i < lengths.size(); ++i) {
      lengths[i] *= shared.scaleOf(values.length_scale.data(), i);
    }
    return shared.model.at(places[capture].first, lengths, values.stiffness.data()).shape;
  }

  Elasticity elasticity() const {
    return shared.model.elasticityAt(blocks.values().stiffness.data(), shared.model.initial());
  }

  // Blocks that only one reading depends on are eliminated first: the shape of its capture or, if
  // shapes come from the model, its tag.
  int eliminationGroup(const ParameterBlocks::Block& block) const {
    const ParameterBlock first =
        shared.selection.free_shapes ? ParameterBlock::kShape : ParameterBlock::kTag;
    return block.kind == first ? 0 : 1;
  }
};

CalibrationProblem::CalibrationProblem(const std::vector<ArmCaptures>& arms,
                                       const CalibrationOptions& options,
                                       const Selection& selection)
    : work_(std::make_unique<Workspace>(arms, options, selection)) {}
CalibrationProblem::~CalibrationProblem() = default;

const Selection& CalibrationProblem::selection() const { return work().shared.selection; }
int CalibrationProblem::captures() const { return static_cast<int>(work().places.size()); }
int CalibrationProblem::armOf(int capture) const { return work().places[capture].first; }
const std::vector<ParameterInfo>& CalibrationProblem::parameters() const {
  return work().blocks.infos();
}
const Values& CalibrationProblem::values() const { return work().blocks.values(); }
Values& CalibrationProblem::values() { return work().blocks.values(); }
Eigen::VectorXd CalibrationProblem::vector() const { return work().blocks.vector(); }

Solved CalibrationProblem::solve(double noise_scale, const Included& included,
                                 const Eigen::VectorXd* held) {
  Workspace& work = this->work();
  work.shared.inverse_noise = 1 / noise_scale;
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(options);
  std::vector<std::unique_ptr<ceres::NormalPrior>> priors;
  ceres::Solver::Options solver;
  solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const ParameterBlocks::Block& block : work.blocks.all()) {
    if (block.kind == ParameterBlock::kShape && !included(block.of)) continue;
    double* const data = work.blocks.data(block);
    const ceres::Matrix precision = block.deviation.cwiseInverse().asDiagonal();
    priors.push_back(std::make_unique<ceres::NormalPrior>(precision, block.mean));
    problem.AddResidualBlock(priors.back().get(), nullptr, data);
    solver.linear_solver_ordering->AddElementToGroup(data, work.eliminationGroup(block));
  }
  if (held != nullptr) {
    Eigen::VectorXd& at = work.blocks.values().stiffness;
    const ceres::Matrix precision = (1 / kHeldDeviation) * held->transpose();
    priors.push_back(std::make_unique<ceres::NormalPrior>(precision, at));
    problem.AddResidualBlock(priors.back().get(), nullptr, at.data());
  }
  for (const ReadingTerm& term : work.terms) {
    if (!included(term.cost->place().capture)) continue;
    problem.AddResidualBlock(term.cost.get(), term.loss.get(), work.blocks.data(term.blocks));
  }
  solver.linear_solver_type = ceres::SPARSE_SCHUR;
  solver.max_num_iterations = work.shared.options.max_iterations;
  solver.function_tolerance = 1e-9;
  solver.parameter_tolerance = 1e-10;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  return {isAtItsEnd(summary), summary.final_cost};
}

std::vector<Comparison> CalibrationProblem::compare(double noise_scale) {
  Workspace& work = this->work();
  work.shared.inverse_noise = 1 / noise_scale;
  const ParameterBlocks& blocks = work.blocks;
  std::vector<Comparison> out;
  for (const ReadingTerm& term : work.terms) {
    const double square = term.square(blocks);
    const double limit = term.loss ? term.limit : std::numeric_limits<double>::infinity();
    out.push_back({term.cost->place().capture, term.cost->tag(), term.cost->num_residuals(), square,
                   limit, term.cost->shown(blocks.data(term.blocks).data(), square),
                   term.weight(square)});
  }
  return out;
}

Eigen::MatrixXd CalibrationProblem::information(double noise_scale, const Included& included) {
  Workspace& work = this->work();
  work.shared.inverse_noise = 1 / noise_scale;
  const int columns = work.blocks.columns();
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(columns, columns);
  for (const ReadingTerm& term : work.terms) {
    if (!included(term.cost->place().capture)) continue;
    addInformation(
        term, work.blocks, [&](double square) { return term.weight(square); }, H);
  }
  return H;
}

Eigen::MatrixXd CalibrationProblem::expectedInformation(const Eigen::VectorXd& pressure,
                                                        double noise_scale) {
  Workspace& work = this->work();
  work.shared.inverse_noise = 1 / noise_scale;
  const int columns = work.blocks.columns();
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(columns, columns);
  for (const ReadingTerm& term :
       expectedTerms(work.shared, work.shared.arms.front(), pressure, work.blocks)) {
    addInformation(
        term, work.blocks, [](double) { return 1.0; }, H);
  }
  return H;
}

std::vector<int> CalibrationProblem::shapeSizes() const {
  std::vector<int> sizes;
  for (const ParameterBlocks::Block& block : work().blocks.all()) {
    if (block.kind == ParameterBlock::kShape) sizes.push_back(block.size());
  }
  return sizes;
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
    out[i] = shared.scaleOf(values().length_scale.data(), i);
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
  return selection().free_shapes ? work().freeShape(capture) : work().modelShape(capture);
}

}  // namespace helix_arm::estimation
