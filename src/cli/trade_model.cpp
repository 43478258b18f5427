#include <algorithm>
#include <cmath>
#include <limits>

#include "helix_arm/basics/median_time.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/input_samples.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "trade.hpp"

namespace helix_arm::cli {
namespace {

using statics::Tier;

constexpr int kCorners = 100;
constexpr int kInner = 300;
constexpr int kDrawnShapes = 8;
constexpr int kDenseFactor = 16;  // reference points per segment of a drawn line

// For a scene without load: the loaded tiers are measured all the same.
statics::Load loadOf(const io::Scene& scene) {
  if (scene.model.load()) return *scene.model.load();
  statics::Load none;
  none.mass.assign(scene.arm.sectionCount(), 0.0);
  none.K_eps.assign(scene.arm.sectionCount(), 1.0);
  return none;
}

std::vector<statics::TierSetting> settingsOf(const io::Scene& scene, const statics::Load& load) {
  std::vector<statics::TierSetting> out;
  if (scene.planar && statics::inPlane(load)) out.push_back({Tier::kPlanar, 0});
  out.push_back({Tier::kLinear, 0});
  for (int order = statics::kLeastOrder; order <= statics::kMostOrder; ++order) {
    out.push_back({Tier::kLoaded, order});
  }
  out.push_back({Tier::kExact, 0});
  return out;
}

// Largest distance of the reference points from the line through every kDenseFactor-th of them.
double lineError(const std::vector<Eigen::Vector3d>& meant) {
  double largest = 0.0;
  for (std::size_t i = 0; i + kDenseFactor < meant.size(); i += kDenseFactor) {
    const Eigen::Vector3d from = meant[i], along = meant[i + kDenseFactor] - from;
    for (int j = 1; j < kDenseFactor; ++j) {
      const Eigen::Vector3d there = meant[i + j] - from;
      const double t = std::clamp(there.dot(along) / along.squaredNorm(), 0.0, 1.0);
      largest = std::max(largest, (there - t * along).norm());
    }
  }
  return largest;
}

// Points of the curve, and of each muscle along it, at `points` positions per section.
void drawMuscles(const model::Arm& arm, const std::vector<model::CurvePoint<lie::SE3>>& curve,
                 int points, std::vector<std::vector<Eigen::Vector3d>>& lines) {
  lines.resize(arm.actuatorCount());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      lines[i].clear();
      for (int j = k * points; j <= (k + 1) * points; ++j) {
        lines[i].push_back(
            curve[j].X *
            model::poseAlong(arm.actuator(i), static_cast<double>(j - k * points) / points)
                .translation);
      }
    }
  }
}

}  // namespace

std::vector<TradeRow> modelRows(const io::Scene& scene) {
  const statics::Load load = loadOf(scene);
  const statics::ExactArm exact(scene.arm, load);
  std::vector<Eigen::VectorXd> inputs;
  std::vector<Eigen::Vector3d> tips;
  for (const Eigen::VectorXd& q : statics::sampleInputs(scene.arm, kCorners, kInner)) {
    const statics::Solution solution = exact.solve(statics::unloadedUnder(scene.arm, load, q));
    if (!solution.converged()) continue;
    inputs.push_back(q);
    tips.push_back(solution.tip.translation);
  }
  std::vector<TradeRow> rows;
  if (inputs.empty()) return rows;
  for (const statics::TierSetting& setting : settingsOf(scene, load)) {
    const statics::ArmModel tier(scene.arm, scene.planar, load, setting);
    double error = 0.0;
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      const statics::Tip found = tier.tip(inputs[i]);
      error = std::max(error, found.converged() ? (found.tip.translation - tips[i]).norm()
                                                : std::numeric_limits<double>::infinity());
    }
    std::size_t next = 0;
    const double time = basics::medianTime([&] {
      tier.tip(inputs[next]);
      next = next + 1 < inputs.size() ? next + 1 : 0;
    });
    rows.push_back({"model", nameOf(setting.tier),
                    setting.tier == Tier::kLoaded ? "order " + std::to_string(setting.order) : "",
                    time, error / scene.arm.restLength()});
  }
  return rows;
}

std::vector<TradeRow> drawingRows(const io::Scene& scene) {
  const model::Arm& arm = scene.arm;
  std::vector<model::Shape> shapes;
  for (const Eigen::VectorXd& q : statics::sampleInputs(arm, 0, kDrawnShapes)) {
    statics::Solution solution = scene.model.solve(q);
    if (solution.converged()) shapes.push_back(std::move(solution.shape));
  }
  std::vector<TradeRow> rows, markers;
  if (shapes.empty()) return rows;
  std::vector<std::vector<Eigen::Vector3d>> lines;
  for (const int points : {4, 8, 16, 24, 48, 96}) {
    const int sections = arm.sectionCount();
    double curve_error = 0.0, muscle_error = 0.0;
    for (const model::Shape& shape : shapes) {
      const auto dense = model::sampleCurve(shape, sections * points * kDenseFactor + 1);
      std::vector<Eigen::Vector3d> curve;
      for (const auto& point : dense) curve.push_back(point.X.translation);
      curve_error = std::max(curve_error, lineError(curve));
      drawMuscles(arm, dense, points * kDenseFactor, lines);
      for (const auto& line : lines) muscle_error = std::max(muscle_error, lineError(line));
    }
    const double curve_time =
        basics::medianTime([&] { model::sampleCurve(shapes.back(), sections * points + 1); });
    const double muscle_time = basics::medianTime([&] {
      drawMuscles(arm, model::sampleCurve(shapes.back(), sections * points + 1), points, lines);
    });
    const std::string setting = std::to_string(points) + " points per section";
    rows.push_back({"curve", "base curve", setting, curve_time, curve_error / arm.restLength()});
    markers.push_back(
        {"markers", "muscles", setting, muscle_time, muscle_error / arm.restLength()});
  }
  rows.insert(rows.end(), markers.begin(), markers.end());
  return rows;
}

}  // namespace helix_arm::cli
