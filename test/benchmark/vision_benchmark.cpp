// From a webcam's JPEG to the arm's shape: ours beside the chain that people build of the same
// libraries. One thread; the pictures run forth and back, so that the motion never jumps.
#include <cmath>
#include <memory>
#include <vector>

#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
#include <benchmark/benchmark.h>
#include <gsl/gsl_multimin.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "procedures/loop_config.hpp"
#include "simulation/bodies.hpp"
#include "support/picture_series.hpp"
#include "support/sample_view.hpp"
#include "vision/jpeg.hpp"

namespace helix_arm::benchmark {
namespace {

constexpr int kPictures = 60;

/// Pictures as a webcam sends them: in colour, a little tinted.
struct Recording {
  test::PictureSeries series;
  std::vector<std::vector<std::uint8_t>> jpegs;

  explicit Recording(double factor)
      : series(test::enlarged(test::sampleView(0.8, 1, 20), factor), kPictures, config()) {
    cv::setNumThreads(1);  // one thread for everybody
    for (const cv::Mat& gray : series.pictures) {
      cv::Mat colour;
      const cv::Mat channels[] = {0.9 * gray, 1.0 * gray, 0.95 * gray};
      cv::merge(channels, 3, colour);
      jpegs.emplace_back();
      cv::imencode(".jpg", colour, jpegs.back(), {cv::IMWRITE_JPEG_QUALITY, 90});
    }
  }

  static simulation::SimulatedCameraConfig config() {
    simulation::SimulatedCameraConfig config;
    config.clutter = 12;
    return config;
  }
};

const Recording& recording(bool full_hd) {
  static const Recording hd(1.0);
  static const Recording fhd(1.5);
  return full_hd ? fhd : hd;
}

// 0, 1, .., n - 1, n - 2, .., 1, 0, 1, ..
class ForthAndBack {
 public:
  int next() {
    const int period = 2 * (kPictures - 1);
    const int step = at_++ % period;
    return step < kPictures ? step : period - step;
  }

 private:
  int at_ = 0;
};

void observation(::benchmark::State& state, bool full_hd) {
  const Recording& source = recording(full_hd);
  vision::ArmLocalizer localizer(source.series.view, {});  // it tracks edges
  vision::JpegDecoder decoder;
  cv::Mat gray;
  ForthAndBack order;
  double tags = 0, searched = 0, count = 0;
  localizer.locate(source.series.pictures[0], source.series.model[0]);
  for (auto _ : state) {
    const int i = order.next();
    if (decoder.decode(source.jpegs[i].data(), source.jpegs[i].size(), gray)) {
      state.SkipWithError("a picture was not decoded");
    }
    const vision::Observation& seen = localizer.locate(gray, source.series.model[i]);
    if (seen.state != vision::ObservationState::kMeasured) state.SkipWithError("no measurement");
    tags += static_cast<double>(seen.detections.size());
    searched += seen.whole_picture ? 1 : 0;
    count += 1;
  }
  state.counters["tags"] = tags / count;
  state.counters["searched_whole"] = searched / count;
}

/// libapriltag as it comes, its refinement of edges on.
class PlainDetector {
 public:
  explicit PlainDetector(double decimate) {
    apriltag_detector_add_family(detector_.get(), family_.get());
    detector_->quad_decimate = static_cast<float>(decimate);
    detector_->refine_edges = true;
    detector_->nthreads = 1;
  }

  std::unique_ptr<zarray_t, void (*)(zarray_t*)> detect(const cv::Mat& gray) {
    image_u8_t image{gray.cols, gray.rows, static_cast<int>(gray.step[0]), gray.data};
    return {apriltag_detector_detect(detector_.get(), &image), apriltag_detections_destroy};
  }

 private:
  std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)> family_{tag36h11_create(),
                                                                           tag36h11_destroy};
  std::unique_ptr<apriltag_detector_t, void (*)(apriltag_detector_t*)> detector_{
      apriltag_detector_create(), apriltag_detector_destroy};
};

// The chain: decode, rectify, detect in the whole picture, one solvePnP a tag.
void searchOfPeer(::benchmark::State& state, bool full_hd, bool colour, double decimate) {
  const Recording& source = recording(full_hd);
  const estimation::Camera& camera = source.series.view.camera;
  const cv::Mat K =
      (cv::Mat_<double>(3, 3) << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
  const cv::Mat distortion = cv::Mat(1, 8, CV_64F, const_cast<double*>(camera.distortion.data()));
  cv::Mat map_1, map_2;
  cv::initUndistortRectifyMap(K, distortion, {}, K, {camera.width, camera.height}, CV_16SC2, map_1,
                              map_2);
  PlainDetector detector(decimate);
  const double h = 0.5 * source.series.view.layout.size;
  const std::vector<cv::Point3d> square = {{-h, -h, 0}, {h, -h, 0}, {h, h, 0}, {-h, h, 0}};
  cv::Mat picture, rectified, gray;
  ForthAndBack order;
  double tags = 0, count = 0;
  for (auto _ : state) {
    picture =
        cv::imdecode(source.jpegs[order.next()], colour ? cv::IMREAD_COLOR : cv::IMREAD_GRAYSCALE);
    cv::remap(picture, rectified, map_1, map_2, cv::INTER_LINEAR);
    if (colour) {
      cv::cvtColor(rectified, gray, cv::COLOR_BGR2GRAY);
    } else {
      gray = rectified;
    }
    const auto found = detector.detect(gray);
    for (int i = 0; i < zarray_size(found.get()); ++i) {
      const apriltag_detection_t* tag = nullptr;
      zarray_get(found.get(), i, &tag);
      std::vector<cv::Point2d> corners;
      for (const auto& p : tag->p) corners.emplace_back(p[0] - 0.5, p[1] - 0.5);
      cv::Vec3d turn, place;
      cv::solvePnP(square, corners, K, cv::noArray(), turn, place);
      ::benchmark::DoNotOptimize(place);
    }
    tags += zarray_size(found.get());
    count += 1;
  }
  state.counters["tags"] = tags / count;
}

void decode(::benchmark::State& state, bool full_hd) {
  const Recording& source = recording(full_hd);
  vision::JpegDecoder decoder;
  cv::Mat gray;
  ForthAndBack order;
  for (auto _ : state) {
    const auto& jpeg = source.jpegs[order.next()];
    if (decoder.decode(jpeg.data(), jpeg.size(), gray)) state.SkipWithError("not decoded");
  }
}

BENCHMARK_CAPTURE(decode, 720p, false)->Unit(::benchmark::kMicrosecond);
BENCHMARK_CAPTURE(decode, 1080p, true)->Unit(::benchmark::kMicrosecond);
BENCHMARK_CAPTURE(observation, 720p_edges, false)->Unit(::benchmark::kMicrosecond);
BENCHMARK_CAPTURE(observation, 1080p_edges, true)->Unit(::benchmark::kMicrosecond);
BENCHMARK_CAPTURE(searchOfPeer, 720p_colour, false, true, 1.0)->Unit(::benchmark::kMicrosecond);
BENCHMARK_CAPTURE(searchOfPeer, 720p_gray, false, false, 2.0)->Unit(::benchmark::kMicrosecond);
BENCHMARK_CAPTURE(searchOfPeer, 1080p_colour, true, true, 1.0)->Unit(::benchmark::kMicrosecond);
BENCHMARK_CAPTURE(searchOfPeer, 1080p_gray, true, false, 2.0)->Unit(::benchmark::kMicrosecond);

// ---- Fits ---------------------------------------------------------------------------------------

// A warm fit of one section's twist to eight tags, beside GSL's simplex on the same objective from
// the same starts (the twist of the last picture).

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

// Poses of the bodies of the shipped scene to a shape, with the search for mistakes in them.
void locateBodies(::benchmark::State& state) {
  const io::Scene scene = io::loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/mocap.yaml");
  vision::ArmLocalizer localizer(scene.view(), procedures::localizerConfigOf(scene));
  simulation::SimulatedBodies bodies(scene.view(), {});
  std::vector<model::Shape> shapes;
  std::vector<std::vector<estimation::BodyPose>> poses;
  for (int i = 0; i < kScenes; ++i) {
    const double time = 2 * M_PI * i / kScenes;
    const Eigen::Vector3d share(0.4 + 0.2 * std::sin(time), 0.4 + 0.2 * std::cos(time), 0.3);
    shapes.push_back(scene.model.solve(scene.arm.inputAt(share)).shape);
    poses.push_back(bodies.see(shapes.back()));
  }
  std::size_t i = 0;
  for (auto _ : state) {
    const std::size_t k = i++ % kScenes;
    const auto& seen = localizer.locate(poses[k], shapes[k]);
    if (seen.state != vision::ObservationState::kMeasured) state.SkipWithError("not measured");
  }
}

BENCHMARK(locateBodies)->Unit(::benchmark::kMicrosecond);
BENCHMARK(fit)->Unit(::benchmark::kMicrosecond);
BENCHMARK(fitOfPeer)->Unit(::benchmark::kMicrosecond);

}  // namespace
}  // namespace helix_arm::benchmark
