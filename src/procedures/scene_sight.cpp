#include "scene_sight.hpp"

#include <string>

#include "helix_arm/estimation/calibration_parameters.hpp"

namespace helix_arm::procedures {
namespace {

using estimation::FitParameter;

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

}  // namespace

std::optional<estimation::PlacedSight> placedSightOf(const io::Scene& scene) {
  if (!scene.camera || !scene.tags) return std::nullopt;
  estimation::PlacedSight out{
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

}  // namespace helix_arm::procedures
