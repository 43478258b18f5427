#include "calibration_problem.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

#include "reading_costs.hpp"

namespace helix_arm::estimation {
namespace {

// Of the log of a stiffness that is held during a search: Ceres 1 and 2 have no common way to hold
// one entry of a block.
constexpr double kHeldDeviation = 1e-4;
// A search whose last step lowers the cost by less is at its end: a parameter that is off by its
// standard error costs 0.5. Where the robust loss holds readings off, steps shrink slowly and go on
// long after they matter.
constexpr double kSettledStep = 1e-4;

bool isAtItsEnd(const ceres::Solver::Summary& summary) {
  if (summary.termination_type == ceres::CONVERGENCE) return true;
  const ceres::IterationSummary& last = summary.iterations.back();
  return summary.termination_type == ceres::NO_CONVERGENCE && last.step_is_successful &&
         last.cost_change < kSettledStep;
}

const char* parameterName(StiffnessEntry entry) {
  switch (entry) {
    case StiffnessEntry::kKappa:
      return "K_kappa";
    case StiffnessEntry::kGamma:
      return "K_gamma";
    case StiffnessEntry::kEps:
      return "K_eps";
    case StiffnessEntry::kTau:
      break;
  }
  return "K_tau";
}

const char* unitOf(StiffnessEntry entry) {
  if (entry == StiffnessEntry::kEps) return "N";
  return entry == StiffnessEntry::kGamma ? "" : "m^2";
}

}  // namespace

Selection selectionOf(const CalibrationOptions& options) {
  Selection selection;
  if (options.K_kappa) selection.stiffness.push_back(StiffnessEntry::kKappa);
  if (options.K_gamma) selection.stiffness.push_back(StiffnessEntry::kGamma);
  if (options.K_tau) selection.stiffness.push_back(StiffnessEntry::kTau);
  if (options.K_eps) selection.stiffness.push_back(StiffnessEntry::kEps);
  selection.length_scale = options.length_scale;
  selection.base = options.base;
  selection.tags = options.tags;
  selection.bleed = options.bleed;
  selection.free_shapes = options.free_shapes;
  return selection;
}

struct CalibrationProblem::Workspace {
  struct Term {
    std::unique_ptr<ReadingCost> cost;
    std::vector<double*> parameters;
    std::unique_ptr<ceres::LossFunction> loss;  // none for twists, whose covariance is given
    double limit;                               // squared residuals beyond which it is an outlier
  };
  // A block of parameters as Ceres has it.
  struct Block {
    double* data;
    Eigen::VectorXd deviation;  // of its prior
    bool shape;                 // of one capture
    int capture = -1;
    const double* prior = nullptr;  // mean; 0 without one
  };

  const std::vector<ArmCaptures>& arms;
  Shared shared;
  Values values;
  std::vector<Block> blocks;  // global ones first
  std::vector<ParameterInfo> infos;
  std::vector<Term> terms;
  std::vector<std::pair<int, int>> places;  // arm and index of each capture
  std::vector<Eigen::VectorXd> shape_means;
  int held_tag = -1;

  Workspace(const std::vector<ArmCaptures>& data, const CalibrationOptions& options,
            const Selection& selection)
      : arms(data), shared(data, options, selection) {
    for (std::size_t a = 0; a < arms.size(); ++a) {
      for (std::size_t c = 0; c < arms[a].captures.size(); ++c) {
        places.emplace_back(static_cast<int>(a), static_cast<int>(c));
      }
    }
    values.stiffness.setZero(static_cast<Eigen::Index>(selection.stiffness.size()));
    values.length_scale.setZero(shared.scales());
    const TagLayout& layout = arms.front().layout;
    values.tags.assign(layout.tags.size(), lie::Vector6::Zero());
    // It fixes the frame that all is seen from.
    held_tag = layout.baseTag();
    addParameters();
    for (std::size_t c = 0; c < places.size(); ++c) addTerms(static_cast<int>(c));
  }

  const ArmCaptures& armOf(int capture) const { return arms[places[capture].first]; }
  const Capture& captureOf(int capture) const {
    return armOf(capture).captures[places[capture].second];
  }

  void addBlock(double* data, Eigen::VectorXd deviation) {
    blocks.push_back({data, std::move(deviation), false});
  }

  void addParameters() {
    const Selection& selection = shared.selection;
    const CalibrationOptions& options = shared.options;
    if (!selection.free_shapes && values.stiffness.size() > 0) {
      addBlock(values.stiffness.data(),
               Eigen::VectorXd::Constant(values.stiffness.size(), options.stiffness_prior));
      Elasticity initial = shared.model.initial();
      for (const StiffnessEntry entry : selection.stiffness) {
        infos.push_back({parameterName(entry), unitOf(entry), options.stiffness_prior, true,
                         shared.model.referenceOf(entry), entryOf(initial, entry), true});
      }
    }
    if (!selection.free_shapes && shared.scales() > 0) {
      addBlock(values.length_scale.data(),
               Eigen::VectorXd::Constant(shared.scales(), options.length_scale_prior));
      for (int i = 0; i < shared.scales(); ++i) {
        const std::string suffix =
            shared.scales() == 1 ? "" : "_" + arms.front().arm.actuator(i).name;
        infos.push_back(
            {"length_scale" + suffix, "", options.length_scale_prior, true, 1.0, 1.0, true});
      }
    }
    const auto addMotion = [this](const std::string& prefix, const char* const(&names)[6],
                                  const Eigen::VectorXd& deviation) {
      for (int i = 0; i < 6; ++i) {
        infos.push_back(
            {prefix + names[i], i < 3 ? "m" : "rad", deviation[i], false, 0.0, 0.0, false});
      }
    };
    if (selection.base) {
      Eigen::VectorXd deviation(6);
      deviation << Eigen::Vector3d::Constant(options.base_prior.translation),
          Eigen::Vector3d::Constant(options.base_prior.rotation);
      addBlock(values.base.data(), deviation);
      addMotion("base_", {"x", "y", "z", "rx", "ry", "rz"}, deviation);
    }
    if (selection.bleed) {
      addBlock(&values.bleed, Eigen::VectorXd::Constant(1, options.bleed_prior));
      infos.push_back({"bleed", "m", options.bleed_prior, false, 0.0, 0.0, false});
    }
    if (selection.tags) {
      Eigen::VectorXd deviation(6);
      deviation << Eigen::Vector3d::Constant(options.tag_prior.translation),
          Eigen::Vector3d::Constant(options.tag_prior.rotation);
      const TagLayout& layout = arms.front().layout;
      for (std::size_t i = 0; i < layout.tags.size(); ++i) {
        if (static_cast<int>(i) == held_tag) continue;
        addBlock(values.tags[i].data(), deviation);
        addMotion("tag_" + std::to_string(layout.tags[i].id) + "_",
                  {"along", "y", "z", "rx", "ry", "rz"}, deviation);
      }
    }
    if (!selection.free_shapes) return;
    // Ceres keeps pointers to these.
    values.shapes.reserve(places.size());
    shape_means.reserve(places.size());
    shared.expected_shapes.reserve(places.size());
    for (std::size_t c = 0; c < places.size(); ++c) {
      const ArmCaptures& data = armOf(static_cast<int>(c));
      const std::vector<int> entries = freeEntries(data);
      shared.expected_shapes.push_back(modelShape(static_cast<int>(c)));
      const model::Twists model = shared.expected_shapes.back().twists();
      Eigen::VectorXd mean(entries.size()), deviation(entries.size());
      for (std::size_t i = 0; i < entries.size(); ++i) {
        mean[i] = model.data()[entries[i]];
        deviation[i] =
            entries[i] % 6 < 3 ? options.model_prior.translation : options.model_prior.rotation;
      }
      values.shapes.push_back(mean);
      shape_means.push_back(mean);
      blocks.push_back({values.shapes.back().data(), deviation, true, static_cast<int>(c),
                        shape_means.back().data()});
    }
  }

  model::Shape freeShape(int capture) const {
    model::Twists twists(6, armOf(capture).arm.sectionCount());
    twists.setZero();
    const std::vector<int> entries = freeEntries(armOf(capture));
    for (std::size_t i = 0; i < entries.size(); ++i) {
      twists.data()[entries[i]] = values.shapes[capture][static_cast<Eigen::Index>(i)];
    }
    return shared.expected_shapes[capture].about(twists);
  }

  model::Shape modelShape(int capture) {
    Eigen::VectorXd lengths = armOf(capture).arm.lengths(captureOf(capture).pressure);
    for (int i = 0; i < lengths.size(); ++i) {
      lengths[i] *= shared.scaleOf(values.length_scale.data(), i);
    }
    return shared.model.at(places[capture].first, lengths, values.stiffness.data()).shape;
  }

  // Pointers of a cost's parameters, in its order.
  std::vector<double*> parametersOf(const ReadingCost& cost) {
    std::vector<double*> out(cost.parameterBlocks());
    const Blocks& at = cost.blocks();
    const auto put = [&out](int index, double* data) {
      if (index >= 0) out[index] = data;
    };
    put(at.stiffness, values.stiffness.data());
    put(at.scale, values.length_scale.data());
    if (at.shape >= 0) out[at.shape] = values.shapes[cost.place().capture].data();
    put(at.base, values.base.data());
    put(at.bleed, &values.bleed);
    if (at.tag >= 0) out[at.tag] = values.tags[cost.tag()].data();
    return out;
  }

  template <class Observation>
  std::unique_ptr<ReadingCost> tagCost(const Place& place, const Observation& seen) {
    const ArmCaptures& data = arms[place.arm];
    const bool free = seen.tag != held_tag;
    if constexpr (std::is_same_v<Observation, CornerObservation>) {
      const CornerModel model{data.X_CB, data.focal / shared.options.corner_noise, shared.expected};
      return std::make_unique<TagCost<CornerModel>>(shared, place, model, seen, free);
    } else {
      return std::make_unique<TagCost<PoseModel>>(shared, place, PoseModel{shared.expected}, seen,
                                                  free);
    }
  }

  std::vector<std::unique_ptr<ReadingCost>> costsOf(const Place& place, const Reading& reading) {
    std::vector<std::unique_ptr<ReadingCost>> costs;
    if (const auto* curvature = std::get_if<CurvatureReading>(&reading)) {
      costs.push_back(std::make_unique<CurvatureCost>(shared, place, curvature->curvature));
    } else if (const auto* twists = std::get_if<TwistReading>(&reading)) {
      costs.push_back(std::make_unique<TwistCost>(shared, place, *twists));
    } else if (const auto* poses = std::get_if<std::vector<PoseObservation>>(&reading)) {
      for (const PoseObservation& seen : *poses) costs.push_back(tagCost(place, seen));
    } else {
      for (const CornerObservation& seen : std::get<std::vector<CornerObservation>>(reading)) {
        costs.push_back(tagCost(place, seen));
      }
    }
    return costs;
  }

  void addTerms(int capture) {
    const Capture& measured = captureOf(capture);
    const Place place{places[capture].first, capture,
                      armOf(capture).arm.lengths(measured.pressure)};
    const bool robust = !std::holds_alternative<TwistReading>(measured.reading);
    for (std::unique_ptr<ReadingCost>& cost : costsOf(place, measured.reading)) {
      Term term;
      const double scale = shared.options.robust_scale * std::sqrt(cost->num_residuals());
      term.limit = scale * scale;
      if (robust) term.loss = std::make_unique<ceres::CauchyLoss>(scale);
      term.parameters = parametersOf(*cost);
      term.cost = std::move(cost);
      terms.push_back(std::move(term));
    }
  }

  double squareOf(const Term& term, std::vector<double>& residuals) const {
    residuals.resize(term.cost->num_residuals());
    if (!term.cost->Evaluate(term.parameters.data(), residuals.data(), nullptr)) {
      return std::numeric_limits<double>::infinity();
    }
    return Eigen::Map<const Eigen::VectorXd>(residuals.data(),
                                             static_cast<Eigen::Index>(residuals.size()))
        .squaredNorm();
  }

  double weightOf(const Term& term, double square) const {
    return term.loss ? 1 / (1 + square / term.limit) : 1.0;
  }

  // First column of a block among all free parameters, and how many there are.
  int columnOf(const double* data) const {
    int column = 0;
    for (const Block& block : blocks) {
      if (block.data == data) return column;
      column += static_cast<int>(block.deviation.size());
    }
    return -1;
  }
  int columns() const {
    int count = 0;
    for (const Block& block : blocks) count += static_cast<int>(block.deviation.size());
    return count;
  }

  void addInformation(const ReadingCost& cost, const std::vector<double*>& parameters,
                      const std::function<double(double)>& weigh, Eigen::MatrixXd& H) const {
    const int rows = cost.num_residuals();
    std::vector<double> residuals(rows);
    std::vector<RowMajor> jacobians;
    std::vector<double*> pointers;
    for (const int size : cost.parameter_block_sizes()) jacobians.emplace_back(rows, size);
    for (RowMajor& jacobian : jacobians) pointers.push_back(jacobian.data());
    if (!cost.Evaluate(parameters.data(), residuals.data(), pointers.data())) return;
    const double weight =
        weigh(Eigen::Map<const Eigen::VectorXd>(residuals.data(), rows).squaredNorm());
    for (std::size_t i = 0; i < jacobians.size(); ++i) {
      const int row = columnOf(parameters[i]);
      for (std::size_t j = 0; j < jacobians.size(); ++j) {
        const int column = columnOf(parameters[j]);
        H.block(row, column, jacobians[i].cols(), jacobians[j].cols()) +=
            weight * (jacobians[i].transpose() * jacobians[j]);
      }
    }
  }
};

CalibrationProblem::CalibrationProblem(const std::vector<ArmCaptures>& arms,
                                       const CalibrationOptions& options,
                                       const Selection& selection)
    : work_(std::make_unique<Workspace>(arms, options, selection)) {}
CalibrationProblem::~CalibrationProblem() = default;

const Selection& CalibrationProblem::selection() const { return work_->shared.selection; }
int CalibrationProblem::captures() const { return static_cast<int>(work_->places.size()); }
int CalibrationProblem::armOf(int capture) const { return work_->places[capture].first; }
const std::vector<ParameterInfo>& CalibrationProblem::parameters() const { return work_->infos; }
Values& CalibrationProblem::values() { return work_->values; }

Eigen::VectorXd CalibrationProblem::vector() const {
  Eigen::VectorXd out(static_cast<Eigen::Index>(work_->infos.size()));
  int at = 0;
  for (const Workspace::Block& block : work_->blocks) {
    if (block.shape) continue;
    out.segment(at, block.deviation.size()) =
        Eigen::Map<const Eigen::VectorXd>(block.data, block.deviation.size());
    at += static_cast<int>(block.deviation.size());
  }
  return out;
}

Solved CalibrationProblem::solve(double noise_scale, const Included& included,
                                 std::optional<int> held) {
  Workspace& work = *work_;
  work.shared.inverse_noise = 1 / noise_scale;
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(options);
  std::vector<std::unique_ptr<ceres::NormalPrior>> priors;
  ceres::Solver::Options solver;
  solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const Workspace::Block& block : work.blocks) {
    if (block.shape && !included(block.capture)) continue;
    const int size = static_cast<int>(block.deviation.size());
    ceres::Vector mean = ceres::Vector::Zero(size);
    if (block.prior != nullptr) mean = Eigen::Map<const Eigen::VectorXd>(block.prior, size);
    const ceres::Matrix precision = block.deviation.cwiseInverse().asDiagonal();
    priors.push_back(std::make_unique<ceres::NormalPrior>(precision, mean));
    problem.AddResidualBlock(priors.back().get(), nullptr, block.data);
    // What each reading sees only one of is eliminated first: the shape of its capture, or, where
    // shapes are the model's, its tag.
    const bool is_tag = !work.values.tags.empty() &&
                        block.data >= work.values.tags.front().data() &&
                        block.data <= work.values.tags.back().data();
    const bool first = work.shared.selection.free_shapes ? block.shape : is_tag;
    solver.linear_solver_ordering->AddElementToGroup(block.data, first ? 0 : 1);
  }
  if (held) {
    const Eigen::VectorXd& at = work.values.stiffness;
    ceres::Matrix precision = ceres::Matrix::Zero(1, at.size());
    precision(0, *held) = 1 / kHeldDeviation;
    priors.push_back(std::make_unique<ceres::NormalPrior>(precision, at));
    problem.AddResidualBlock(priors.back().get(), nullptr, work.values.stiffness.data());
  }
  for (const Workspace::Term& term : work.terms) {
    if (!included(term.cost->place().capture)) continue;
    problem.AddResidualBlock(term.cost.get(), term.loss.get(), term.parameters);
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

std::vector<Comparison> CalibrationProblem::compare(double noise_scale) const {
  Workspace& work = *work_;
  work.shared.inverse_noise = 1 / noise_scale;
  std::vector<Comparison> out;
  std::vector<double> residuals;
  for (const Workspace::Term& term : work.terms) {
    const double square = work.squareOf(term, residuals);
    const double limit = term.loss ? term.limit : std::numeric_limits<double>::infinity();
    out.push_back({term.cost->place().capture, term.cost->tag(), term.cost->num_residuals(), square,
                   limit, term.cost->shown(term.parameters.data(), square),
                   work.weightOf(term, square)});
  }
  return out;
}

Eigen::MatrixXd CalibrationProblem::information(double noise_scale,
                                                const Included& included) const {
  Workspace& work = *work_;
  work.shared.inverse_noise = 1 / noise_scale;
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(work.columns(), work.columns());
  for (const Workspace::Term& term : work.terms) {
    if (!included(term.cost->place().capture)) continue;
    work.addInformation(
        *term.cost, term.parameters, [&](double square) { return work.weightOf(term, square); }, H);
  }
  return H;
}

Eigen::MatrixXd CalibrationProblem::expectedInformation(const Eigen::VectorXd& pressure,
                                                        double noise_scale) const {
  Workspace& work = *work_;
  work.shared.inverse_noise = 1 / noise_scale;
  const ArmCaptures& data = work.arms.front();
  const Place place{0, 0, data.arm.lengths(pressure)};
  // The readings of the captures there are, each tag once.
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(work.columns(), work.columns());
  std::vector<bool> seen(data.layout.tags.size(), false);
  const auto add = [&](const Reading& reading) {
    for (const std::unique_ptr<ReadingCost>& cost : work.costsOf(place, reading)) {
      const std::vector<double*> parameters = work.parametersOf(*cost);
      if (const auto* tag = dynamic_cast<const TagCost<CornerModel>*>(cost.get())) {
        if (!tag->faces(parameters.data())) continue;
      }
      work.addInformation(
          *cost, parameters, [](double) { return 1.0; }, H);
    }
  };
  const auto addNew = [&](const auto& observations) {
    auto fresh = observations;
    fresh.erase(std::remove_if(fresh.begin(), fresh.end(),
                               [&seen](const auto& one) {
                                 const bool known = seen[one.tag];
                                 seen[one.tag] = true;
                                 return known;
                               }),
                fresh.end());
    add(fresh);
  };
  for (const Capture& capture : data.captures) {
    if (const auto* poses = std::get_if<std::vector<PoseObservation>>(&capture.reading)) {
      addNew(*poses);
    } else if (const auto* corners =
                   std::get_if<std::vector<CornerObservation>>(&capture.reading)) {
      addNew(*corners);
    } else {
      add(capture.reading);
      break;
    }
  }
  return H;
}

std::vector<int> CalibrationProblem::shapeSizes() const {
  std::vector<int> sizes;
  for (const Workspace::Block& block : work_->blocks) {
    if (block.shape) sizes.push_back(static_cast<int>(block.deviation.size()));
  }
  return sizes;
}

Eigen::VectorXd CalibrationProblem::priorInformation() const {
  Eigen::VectorXd out(work_->columns());
  int at = 0;
  for (const Workspace::Block& block : work_->blocks) {
    out.segment(at, block.deviation.size()) = block.deviation.array().square().inverse();
    at += static_cast<int>(block.deviation.size());
  }
  return out;
}

model::Stiffness CalibrationProblem::stiffness() const {
  const ShapeModel& model = work_->shared.model;
  return model.elasticityAt(work_->values.stiffness.data(), model.initial()).ratios;
}

std::optional<double> CalibrationProblem::K_eps() const {
  const std::vector<StiffnessEntry>& fitted = selection().stiffness;
  if (std::find(fitted.begin(), fitted.end(), StiffnessEntry::kEps) == fitted.end()) {
    return std::nullopt;
  }
  const ShapeModel& model = work_->shared.model;
  return model.elasticityAt(work_->values.stiffness.data(), model.initial()).K_eps;
}

Eigen::VectorXd CalibrationProblem::lengthScale() const {
  Eigen::VectorXd out(work_->arms.front().arm.actuatorCount());
  for (int i = 0; i < out.size(); ++i) {
    out[i] = work_->shared.scaleOf(work_->values.length_scale.data(), i);
  }
  return out;
}

lie::SE3 CalibrationProblem::base() const { return lie::SE3::exp(work_->values.base); }

TagLayout CalibrationProblem::layout() const {
  TagLayout layout = work_->arms.front().layout;
  for (std::size_t i = 0; i < layout.tags.size(); ++i) {
    const int section = layout.tags[i].section;
    const double length = work_->arms.front().arm.restLength(section);
    layout.tags[i] = movedBy(layout.tags[i], work_->values.tags[i], length);
  }
  return layout;
}

model::Shape CalibrationProblem::shape(int capture) const {
  return selection().free_shapes ? work_->freeShape(capture) : work_->modelShape(capture);
}

}  // namespace helix_arm::estimation
