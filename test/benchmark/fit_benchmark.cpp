// A warm fit of one section's twist to eight tags, compared with GSL's simplex from the same starts
// (the twist of the last picture): once on our own objective and group, and once on the
// reprojection error of cv::projectPoints, as is common.
#include <cmath>
#include <vector>

#include <benchmark/benchmark.h>
#include <gsl/gsl_multimin.h>

#include "helix_arm/localization/twist_fit.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::benchmark {
namespace {

constexpr int kScenes = 50;
constexpr double kNoise = 0.3;  // [px]

constexpr double kEqual = 1e-5;  // of costs, in expected variances: what both call converged

constexpr int kPatience = 5000;

struct Scene {
  std::vector<estimation::CornerObservation> seen;
  model::Twists start;
  double least;  // cost of our answer
};

struct Problem {
  estimation::ArmView view = test::sampleView();
  estimation::TwistFitOptions options;
  std::vector<Scene> scenes;

  Problem() {
    options.corner_noise = kNoise;
    options.model_prior = {1e3, 1e3};  // the peer has none
    const model::Arm arm = test::ringArm(test::helicalRing());
    estimation::TwistFitter fitter(view.layout, 1, options);
    test::Random random(12);
    for (int i = 0; i < kScenes; ++i) {
      const model::Twists twists = arm.twists(test::randomInput(arm, random));
      const auto tags = test::spread(estimation::visibleTags(view, twists, 0.35), 8);
      Scene scene{test::observe(view, tags, kNoise, random), twists, 0};
      for (int k = 0; k < 3; ++k) {
        scene.start(k, 0) += 0.002 * random.normal();
        scene.start(3 + k, 0) += 0.02 * random.normal();
      }
      scene.least = fitter.fit(scene.seen, view.X_CB, view.camera.fx, scene.start).cost;
      scenes.push_back(std::move(scene));
    }
  }
};

const Problem& problem() {
  static const Problem the_problem;
  return the_problem;
}

void fit(::benchmark::State& state) {
  estimation::TwistFitter fitter(problem().view.layout, 1, problem().options);
  std::size_t i = 0;
  double cost = 0, count = 0;
  for (auto _ : state) {
    const Scene& scene = problem().scenes[i++ % kScenes];
    const auto& result =
        fitter.fit(scene.seen, problem().view.X_CB, problem().view.camera.fx, scene.start);
    if (result.status != estimation::FitStatus::kConverged) state.SkipWithError("not converged");
    if (count < kScenes) cost += result.cost;
    count += 1;
  }
  if (count >= kScenes) state.counters["cost"] = cost / kScenes;
}

double robust(double square) {
  const double scale = problem().options.robust_scale, threshold = 8 * scale * scale;
  return threshold * std::log1p(square / (kNoise * kNoise) / threshold);
}

double costOf(const gsl_vector* x, void* scene_pointer) {
  const auto& scene = *static_cast<const Scene*>(scene_pointer);
  const estimation::ArmView& view = problem().view;
  const estimation::Corners plane = view.layout.corners();
  const Eigen::Map<const lie::Vector6> twist(x->data);
  const double focal = view.camera.fx;
  double cost = 0;
  for (const auto& tag : scene.seen) {
    const estimation::TagPlacement& placement = view.layout.tags[tag.tag];
    const lie::SE3 X_CT = view.X_CB * (lie::SE3::exp(placement.s * twist) * placement.X_ST);
    double square = 0;
    for (int c = 0; c < 4; ++c) {
      const Eigen::Vector3d p = X_CT * Eigen::Vector3d(plane(0, c), plane(1, c), 0);
      square += (p.head<2>() / p.z() - tag.direction.col(c)).squaredNorm();
    }
    cost += robust(focal * focal * square);
  }
  return cost;
}

// It may stop as soon as it is as good as ours.
void fitOfPeer(::benchmark::State& state) {
  gsl_multimin_fminimizer* simplex =
      gsl_multimin_fminimizer_alloc(gsl_multimin_fminimizer_nmsimplex2, 6);
  gsl_vector* start = gsl_vector_alloc(6);
  gsl_vector* step = gsl_vector_alloc(6);
  std::size_t i = 0;
  double cost = 0, count = 0, iterations = 0, stuck = 0;
  for (auto _ : state) {
    Scene scene = problem().scenes[i++ % kScenes];
    gsl_multimin_function function{&costOf, 6, &scene};
    for (int k = 0; k < 6; ++k) {
      gsl_vector_set(start, k, scene.start(k, 0));
      gsl_vector_set(step, k, k < 3 ? 0.002 : 0.02);
    }
    gsl_multimin_fminimizer_set(simplex, &function, start, step);
    bool equal = false;
    for (int n = 0; n < kPatience && !equal; ++n, iterations += 1) {
      if (gsl_multimin_fminimizer_iterate(simplex) != 0) break;
      equal = gsl_multimin_fminimizer_minimum(simplex) <= scene.least + kEqual;
    }
    if (!equal) stuck += 1;
    if (count < kScenes) cost += gsl_multimin_fminimizer_minimum(simplex);
    count += 1;
  }
  if (count >= kScenes) state.counters["cost"] = cost / kScenes;
  state.counters["iterations"] = iterations / count;
  state.counters["stuck"] = stuck / count;
  gsl_vector_free(step);
  gsl_vector_free(start);
  gsl_multimin_fminimizer_free(simplex);
}

BENCHMARK(fit)->Unit(::benchmark::kMicrosecond);
BENCHMARK(fitOfPeer)->Unit(::benchmark::kMicrosecond);

}  // namespace
}  // namespace helix_arm::benchmark
