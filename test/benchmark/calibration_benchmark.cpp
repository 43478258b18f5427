// Calibrations of the size that labs make. Stiffness of 21 captures of 7 tags, beside a simplex of
// GSL on the same robust objective, as the paper's authors fit. Placement of 50 captures of 8 tags,
// beside Ceres on the same residuals with central differences instead of derivatives.
#include <array>
#include <cmath>
#include <vector>

#include <benchmark/benchmark.h>
#include <ceres/ceres.h>
#include <gsl/gsl_multimin.h>

#include "helix_arm/calibration/calibration.hpp"
#include "support/sample_rig.hpp"

namespace helix_arm::benchmark {
namespace {

using namespace estimation;

constexpr double kPoseNoise = 0.01;   // [m]
constexpr double kCornerNoise = 0.3;  // [px]
constexpr int kPatience = 2000;

// 21 captures of 7 tags of a helical arm, as poses.
const ArmCaptures& stiffnessData() {
  static const ArmCaptures the_data = [] {
    const model::Arm known = test::ringArm(test::helicalRing());
    test::Random random(1);
    const test::RigTruth truth =
        test::drawRig(known, test::sampleView(0.8, 1, 7), {0.2, 0.4, 0, 0, 0, 0, 0, 0}, random);
    ArmCaptures data{"arm", known, false, truth.view.layout, {}, {}, {}};
    for (int i = 0; i < 21; ++i) {
      const Eigen::VectorXd pressure = test::randomInput(known, random);
      std::vector<estimation::PoseObservation> seen;
      for (lie::SE3 X_BT : estimation::tagPoses(data.layout, test::shapeOf(truth, pressure))) {
        for (double& x : X_BT.translation) x += kPoseNoise * random.normal();
        seen.push_back({static_cast<int>(seen.size()), X_BT});
      }
      test::addCapture(data, pressure, std::move(seen));
    }
    return data;
  }();
  return the_data;
}

// 50 captures of 8 tags each, as corners.
const ArmCaptures& placementData() {
  static const ArmCaptures the_data = [] {
    const model::Arm known = test::ringArm(test::helicalRing());
    const estimation::ArmView view = test::sampleView(0.8, 1, 32);
    test::Random random(2);
    const test::RigTruth truth =
        test::drawRig(known, view, {0.2, 0.4, 0.02, 0.01, 0.02, 0.002, 0.05, 0}, random);
    ArmCaptures data{"rig", known, false, view.layout, view.X_CB, view.camera, {}};
    while (data.captures.size() < 50) {
      const Eigen::VectorXd pressure = test::randomInput(known, random);
      const auto seen = test::observe(truth, pressure, kCornerNoise, random);
      if (seen.size() >= 8) test::addCapture(data, pressure, test::spread(seen, 8));
    }
    return data;
  }();
  return the_data;
}

// What a calibration adds to the parameters, each with what precedes it.
enum class Until { kParameters, kErrors, kSuggestions };

CalibrationOptions upTo(Until last, CalibrationOptions options) {
  options.errors = last >= Until::kErrors;
  options.held_out = last >= Until::kSuggestions;
  if (last < Until::kSuggestions) options.next_pressures = 0;
  return options;
}

CalibrationOptions placementOptions() {
  CalibrationOptions options;
  options.fit.insert({FitParameter::kBase, FitParameter::kTags, FitParameter::kBorderShift});
  options.free_shapes = true;
  options.base_prior = {0.1, 0.5};
  return options;
}

void run(::benchmark::State& state, const ArmCaptures& data, const CalibrationOptions& options) {
  double error = 0;
  for (auto _ : state) {
    const Calibration found = calibrate({data}, options);
    if (found.status != CalibrationStatus::kCalibrated) state.SkipWithError(found.reason.c_str());
    error = found.rms;
  }
  state.counters["rms"] = error;
}

void stiffness(::benchmark::State& state, Until last) {
  run(state, stiffnessData(), upTo(last, {}));
}
void placement(::benchmark::State& state) {
  run(state, placementData(), upTo(Until::kParameters, placementOptions()));
}

// The parameters alone. The peers are told the noise that it finds, and must end where their
// objective is as low as here.
const Calibration& stiffnessFound() {
  static const Calibration found = calibrate({stiffnessData()}, upTo(Until::kParameters, {}));
  return found;
}
const Calibration& placementFound() {
  static const Calibration found =
      calibrate({placementData()}, upTo(Until::kParameters, placementOptions()));
  return found;
}

// Half a robust sum of squares. One parameter that is off by its standard error costs 0.5.
constexpr double kEqualCost = 0.005;

void compareCosts(::benchmark::State& state, double ours, double of_peer) {
  state.counters["excess"] = of_peer - ours;
  if (!(std::abs(of_peer - ours) <= kEqualCost)) state.SkipWithError("not the same answer");
}

// Robust cost of the poses at logs of K_kappa and K_gamma over the known ones.
double costOf(const gsl_vector* x, void*) {
  const ArmCaptures& data = stiffnessData();
  model::Stiffness stiffness = data.arm.actuator(0).stiffness;
  stiffness.kappa *= std::exp(gsl_vector_get(x, 0));
  stiffness.gamma *= std::exp(gsl_vector_get(x, 1));
  const model::Arm arm = data.arm.withStiffness(stiffness);
  const CalibrationOptions options;
  const double limit = 3 * options.robust_scale * options.robust_scale;
  const double noise = kPoseNoise * stiffnessFound().noise_scale;
  double cost = 0;
  for (int i = 0; i < 2; ++i) {
    cost += std::pow(gsl_vector_get(x, i) / options.stiffness_prior, 2);
  }
  for (const Capture& capture : data.captures) {
    const auto model = estimation::tagPoses(data.layout, arm.twists(capture.pressure));
    for (const auto& seen : std::get<std::vector<estimation::PoseObservation>>(capture.reading)) {
      const double square =
          (model[seen.tag].translation - seen.X_BT.translation).squaredNorm() / (noise * noise);
      cost += limit * std::log1p(square / limit);
    }
  }
  return cost / 2;
}

void stiffnessOfPeer(::benchmark::State& state) {
  gsl_multimin_fminimizer* simplex =
      gsl_multimin_fminimizer_alloc(gsl_multimin_fminimizer_nmsimplex2, 2);
  gsl_vector* start = gsl_vector_calloc(2);
  gsl_vector* step = gsl_vector_alloc(2);
  gsl_vector_set_all(step, 0.3);
  gsl_multimin_function function{&costOf, 2, nullptr};
  stiffnessFound();
  double iterations = 0, runs = 0;
  for (auto _ : state) {
    gsl_multimin_fminimizer_set(simplex, &function, start, step);
    for (int n = 0; n < kPatience; ++n, iterations += 1) {
      if (gsl_multimin_fminimizer_iterate(simplex) != 0) break;
      // As near as a percent of a standard error or so.
      if (gsl_multimin_fminimizer_size(simplex) < 1e-3) break;
    }
    runs += 1;
  }
  state.counters["iterations"] = iterations / runs;
  gsl_vector* ours = gsl_vector_alloc(2);
  for (int i = 0; i < 2; ++i) {
    const estimation::Parameter& one = stiffnessFound().parameters[i];
    gsl_vector_set(ours, i, std::log(one.value / one.initial));
  }
  compareCosts(state, costOf(ours, nullptr), costOf(gsl_multimin_fminimizer_x(simplex), nullptr));
  gsl_vector_free(ours);
  gsl_vector_free(step);
  gsl_vector_free(start);
  gsl_multimin_fminimizer_free(simplex);
}

// What a camera sees of one tag, without derivatives.
struct TagResidual {
  const ArmCaptures& data;
  estimation::CornerObservation seen;
  double noise;  // [px]

  bool operator()(const double* twist, const double* base, const double* border_shift,
                  const double* moved, double* residual) const {
    const Eigen::Map<const lie::Vector6> g(twist), b(base), m(moved);
    const estimation::TagPlacement tag =
        estimation::movedBy(data.layout.tags[seen.tag], m, data.arm.restLength(0));
    const lie::SE3 X_CT = data.X_CB * lie::SE3::exp(b) * lie::SE3::exp(tag.s * g) * tag.X_ST;
    const estimation::Corners plane = data.layout.corners(*border_shift);
    for (int c = 0; c < 4; ++c) {
      const Eigen::Vector3d p = X_CT * Eigen::Vector3d(plane(0, c), plane(1, c), 0);
      if (!(p.z() > 0)) return false;
      Eigen::Map<Eigen::Vector2d>(residual + 2 * c) =
          data.camera.focal() / noise * (p.head<2>() / p.z() - seen.direction.col(c));
    }
    return true;
  }
};

// Holds a parameter near where it is thought to be.
template <int kSize>
struct Prior {
  std::array<double, kSize> mean, deviation;
  bool operator()(const double* x, double* residual) const {
    for (int i = 0; i < kSize; ++i) residual[i] = (x[i] - mean[i]) / deviation[i];
    return true;
  }
};
template <int kSize>
void hold(ceres::Problem& problem, double* x, const Prior<kSize>& prior) {
  problem.AddResidualBlock(
      new ceres::NumericDiffCostFunction<Prior<kSize>, ceres::CENTRAL, kSize, kSize>(
          new Prior<kSize>(prior)),
      nullptr, x);
}

// The parameters of a placement, and the peer's problem of them.
struct PlacementProblem {
  using Six = std::array<double, 6>;
  std::vector<Six> twists, tags;
  Six base{}, held{};
  double border_shift = 0;
  ceres::Problem problem;

  PlacementProblem() {
    const ArmCaptures& data = placementData();
    const CalibrationOptions options = placementOptions();
    const double noise = kCornerNoise * placementFound().noise_scale;
    twists.resize(data.captures.size());
    tags.resize(data.layout.tags.size(), Six{});
    const auto holdPose = [this](Six& x, double translation, double rotation) {
      hold<6>(problem, x.data(),
              {x, {translation, translation, translation, rotation, rotation, rotation}});
    };
    for (std::size_t c = 0; c < data.captures.size(); ++c) {
      const model::Twists start = data.arm.twists(data.captures[c].pressure);
      for (int i = 0; i < 6; ++i) twists[c][i] = start(i, 0);
      holdPose(twists[c], options.model_prior.translation, options.model_prior.rotation);
      for (const auto& seen :
           std::get<std::vector<estimation::CornerObservation>>(data.captures[c].reading)) {
        auto* cost = new ceres::NumericDiffCostFunction<TagResidual, ceres::CENTRAL, 8, 6, 6, 1, 6>(
            new TagResidual{data, seen, noise});
        double* const tag = seen.tag == 0 ? held.data() : tags[seen.tag].data();
        problem.AddResidualBlock(cost, new ceres::CauchyLoss(options.robust_scale * std::sqrt(8.0)),
                                 twists[c].data(), base.data(), &border_shift, tag);
      }
    }
    holdPose(base, options.base_prior.translation, options.base_prior.rotation);
    hold<1>(problem, &border_shift, {{0.0}, {options.border_shift_prior}});
    for (std::size_t i = 1; i < tags.size(); ++i) {
      holdPose(tags[i], options.tag_prior.translation, options.tag_prior.rotation);
    }
    if (problem.HasParameterBlock(held.data())) problem.SetParameterBlockConstant(held.data());
  }

  // The values of a calibration: base, border shift, tags but the first, as it lists them.
  void set(const Calibration& found) {
    for (std::size_t c = 0; c < twists.size(); ++c) {
      for (int i = 0; i < 6; ++i) twists[c][i] = found.shapes[c](i, 0);
    }
    for (int i = 0; i < 6; ++i) base[i] = found.parameters[i].value;
    border_shift = found.parameters[6].value;
    for (std::size_t t = 1; t < tags.size(); ++t) {
      for (int i = 0; i < 6; ++i) tags[t][i] = found.parameters[7 + 6 * (t - 1) + i].value;
    }
  }

  double cost() {
    double cost = 0;
    problem.Evaluate(ceres::Problem::EvaluateOptions(), &cost, nullptr, nullptr, nullptr);
    return cost;
  }
};

void placementOfPeer(::benchmark::State& state) {
  PlacementProblem known;
  known.set(placementFound());
  double cost = 0;
  for (auto _ : state) {
    PlacementProblem fit;
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::SPARSE_SCHUR;
    solver.max_num_iterations = 100;
    solver.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &fit.problem, &summary);
    if (summary.termination_type != ceres::CONVERGENCE) state.SkipWithError("not converged");
    state.counters["iterations"] = static_cast<double>(summary.iterations.size());
    cost = summary.final_cost;
  }
  compareCosts(state, known.cost(), cost);
}

BENCHMARK_CAPTURE(stiffness, parameters, Until::kParameters)->Unit(::benchmark::kMillisecond);
BENCHMARK_CAPTURE(stiffness, errors, Until::kErrors)->Unit(::benchmark::kMillisecond);
BENCHMARK_CAPTURE(stiffness, suggestions, Until::kSuggestions)->Unit(::benchmark::kMillisecond);
BENCHMARK(stiffnessOfPeer)->Unit(::benchmark::kMillisecond);
BENCHMARK(placement)->Unit(::benchmark::kMillisecond);
BENCHMARK(placementOfPeer)->Unit(::benchmark::kMillisecond);

}  // namespace
}  // namespace helix_arm::benchmark
