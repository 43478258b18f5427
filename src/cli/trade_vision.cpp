#include <chrono>
#include <cmath>
#include <limits>
#include <sstream>

#include "helix_arm/basics/median.hpp"
#include "helix_arm/estimation/arm_view.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/simulation/rig.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "trade.hpp"

namespace helix_arm::cli {
namespace {

using vision::TrackingMode;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Pictures of the simulated rig in a fast motion, 30 per second.
struct Film {
  std::vector<cv::Mat> pictures;
  std::vector<model::Shape> truth, model;
};

Film shoot(const io::Scene& scene, int count) {
  const simulation::CameraSetup setup = *scene.cameraSetup();
  const simulation::TrueArm true_arm(scene.model, scene.simulation.arm);
  simulation::SimulatedCamera camera(setup.view, setup.family, setup.body, setup.config);
  Film film;
  Eigen::VectorXd share(scene.arm.actuatorCount());
  for (int i = 0; i < count; ++i) {
    // Each actuator oscillates over its range with its own frequency, about once in three seconds.
    for (int k = 0; k < share.size(); ++k) {
      share[k] = 0.5 + 0.48 * std::sin((0.06 + 0.01 * (k % 5)) * i + 2 * k);
    }
    const Eigen::VectorXd q = scene.arm.inputAt(share);
    const statics::Solution expected = scene.model.solve(q);
    if (!expected.converged()) continue;
    film.model.push_back(expected.shape);
    film.truth.push_back(true_arm.shape(q));
    film.pictures.push_back(camera.render(film.truth.back()).clone());
  }
  return film;
}

double tipDistance(const model::Shape& a, const model::Shape& b) {
  return (model::tipPose(a).translation - model::tipPose(b).translation).norm();
}

const char* nameOf(TrackingMode mode) {
  if (mode == TrackingMode::kFull) return "whole picture";
  return mode == TrackingMode::kRegions ? "regions" : "edges";
}

TradeRow searchRow(const io::Scene& scene, const Film& film, TrackingMode mode, double decimate) {
  using Clock = std::chrono::steady_clock;
  vision::LocalizerConfig config = scene.vision;
  config.tracking = mode;
  config.detector.quad_decimate = decimate;
  vision::ArmLocalizer localizer(scene.view(), config);
  std::vector<double> times, errors;
  for (std::size_t i = 0; i < film.pictures.size(); ++i) {
    const Clock::time_point begin = Clock::now();
    const vision::Observation& vision = localizer.locate(film.pictures[i], film.model[i]);
    times.push_back(std::chrono::duration<double>(Clock::now() - begin).count());
    errors.push_back(vision.state == vision::ObservationState::kMeasured
                         ? tipDistance(vision.fit.shape, film.truth[i])
                         : kInfinity);
  }
  std::ostringstream setting;
  setting << "quad_decimate " << decimate;
  return {"sight", nameOf(mode), setting.str(), basics::medianOf(times),
          basics::medianOf(errors) / scene.arm.restLength()};
}

// Parameters that a fit estimates in addition to the shape.
struct FitMode {
  const char* tier;
  const char* setting;
  bool free_base, free_bleed, cold;
};

// The corners of all pictures are detected once, so that only the fit is timed.
std::vector<TradeRow> fitRows(const io::Scene& scene, const Film& film) {
  using Clock = std::chrono::steady_clock;
  const estimation::ArmView view = scene.view();
  const double focal = view.camera.focal();
  vision::TagDetector detector(scene.vision.detector);
  std::vector<std::vector<estimation::CornerObservation>> seen;
  for (const cv::Mat& picture : film.pictures) {
    seen.emplace_back();
    for (const vision::TagDetection& detection : detector.detect(picture)) {
      const int tag = view.layout.find(detection.id);
      if (tag < 0) continue;
      const auto direction = estimation::directionsOf(view.camera, detection.corners);
      if (direction) seen.back().push_back({tag, *direction});
    }
  }
  std::vector<TradeRow> rows;
  for (const FitMode& mode : {FitMode{"corners", "from the model", false, false, false},
                              FitMode{"corners", "base free", true, false, false},
                              FitMode{"corners", "bleed free", false, true, false},
                              FitMode{"corners", "base and bleed free", true, true, false},
                              FitMode{"corners", "cold", false, false, true}}) {
    estimation::TwistFitOptions options = scene.vision.fit;
    options.free_base = mode.free_base;
    options.free_bleed = mode.free_bleed;
    estimation::TwistFitter fitter(view.layout, view.sections, options);
    std::vector<double> times, errors;
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const auto begin = Clock::now();
      const estimation::TwistFit& fit =
          mode.cold ? fitter.fitCold(seen[i], view.X_CB, focal, film.model[i])
                    : fitter.fit(seen[i], view.X_CB, focal, film.model[i]);
      times.push_back(std::chrono::duration<double>(Clock::now() - begin).count());
      const bool measured = fit.status == estimation::FitStatus::kConverged;
      errors.push_back(measured ? (fit.X_B0B * model::tipPose(fit.shape).translation -
                                   model::tipPose(film.truth[i]).translation)
                                      .norm()
                                : kInfinity);
    }
    rows.push_back({"fit", mode.tier, mode.setting, basics::medianOf(times),
                    basics::medianOf(errors) / scene.arm.restLength()});
  }
  return rows;
}

}  // namespace

std::vector<TradeRow> visionRows(const io::Scene& scene, int pictures) {
  const Film film = shoot(scene, pictures);
  std::vector<TradeRow> rows;
  if (film.pictures.empty()) return rows;
  for (const double decimate : {1.0, 1.5, 2.0, 3.0, 4.0}) {
    for (const TrackingMode mode :
         {TrackingMode::kFull, TrackingMode::kRegions, TrackingMode::kEdges}) {
      rows.push_back(searchRow(scene, film, mode, decimate));
    }
  }
  for (TradeRow& row : fitRows(scene, film)) rows.push_back(std::move(row));
  return rows;
}

}  // namespace helix_arm::cli
