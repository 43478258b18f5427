#include "scene_view.hpp"

#include <string>

#include "helix_arm/estimation/calibration_parameters.hpp"
#include "helix_arm/estimation/rig_memory.hpp"
#include "helix_arm/procedures/loop_config.hpp"

namespace helix_arm::procedures {
namespace {

using estimation::FitParameter;
using estimation::RigEstimate;

constexpr double kTypicalInput = 0.3;  // part of the limits

// Replaces deviations by standard errors of parameters "<name><suffix>".
void takeErrors(const io::Provenance& calibration, FitParameter parameter, const std::string& name,
                lie::Vector6& deviations) {
  const auto& numbers = estimation::infoOf(parameter).numbers;
  for (Eigen::Index i = 0; i < deviations.size(); ++i) {
    const std::string wanted = name + numbers[static_cast<std::size_t>(i)].suffix;
    for (const io::Provenance::Parameter& one : calibration.parameters) {
      if (one.name == wanted) deviations[i] = one.standard_error;
    }
  }
}

// The scene's view, as the placements of its tags are known.
estimation::PlacedView nominalViewOf(const io::Scene& scene) {
  estimation::PlacedView out{
      scene.view(), scene.vision.fit, {*scene.tags, scene.tag_prior, scene.vision.fit.base_prior}};
  if (!scene.calibration) return out;
  const auto wordOf = [](FitParameter parameter) -> std::string {
    return estimation::infoOf(parameter).name;
  };
  takeErrors(*scene.calibration, FitParameter::kBase, wordOf(FitParameter::kBase),
             out.deviations.base);
  for (std::size_t i = 0; i < scene.tags->tags.size(); ++i) {
    const std::string name =
        wordOf(FitParameter::kTags) + "_" + std::to_string(scene.tags->tags[i].id);
    takeErrors(*scene.calibration, FitParameter::kTags, name, out.deviations.tags[i]);
  }
  return out;
}

// Of a typical shape, with the tags that face the camera.
RigEstimate::Matrix rigByPlacementsOf(const io::Scene& scene,
                                      const estimation::PlacedView& placed) {
  const Eigen::VectorXd pressure = scene.arm.inputAt(kTypicalInput);
  const model::Shape shape =
      statics::startingShape(scene.model, scene.model.solve(pressure), pressure);
  std::vector<int> tags;
  for (const estimation::TagImage& one : estimation::visibleTags(placed.view, shape)) {
    tags.push_back(one.tag);
  }
  return estimation::rigByPlacements(placed, scene.arm, shape, tags)
      .value_or(RigEstimate::Matrix::Zero());
}

}  // namespace

std::optional<estimation::PlacedView> placedViewOf(const io::Scene& scene) {
  if (!scene.camera || !scene.tags) return std::nullopt;
  estimation::PlacedView out = nominalViewOf(scene);
  if (out.fit.free_base) {
    const auto errors =
        estimation::RigMemory::heldErrors(out.fit, rigByPlacementsOf(scene, out)).diagonal();
    out.deviations.base = errors.head<6>().cwiseSqrt();
  }
  out.fit = estimation::RigMemory::heldOptions(out.fit);
  return out;
}

vision::LocalizerConfig localizerConfigOf(const io::Scene& scene) {
  vision::LocalizerConfig out = scene.vision;
  if (scene.camera && scene.tags) {
    out.rig_by_placements = rigByPlacementsOf(scene, nominalViewOf(scene));
  }
  return out;
}

}  // namespace helix_arm::procedures
