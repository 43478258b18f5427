#include "measurements.hpp"

#include <algorithm>
#include <map>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/basics/median.hpp"
#include "helix_arm/io/tag_poses.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/capture_scatter.hpp"

namespace helix_arm::cli {
namespace {

std::string reasonOf(const io::Scene& scene, const FittedCapture& capture) {
  const std::string check =
      "; check that their positions are in metres and seen from the arm's base, and where the "
      "scene places the tags";
  switch (capture.status) {
    case estimation::FitStatus::kConverged:
      return {};
    case estimation::FitStatus::kNotConverged:
      return "the fit of a shape to its tags did not converge" + check;
    case estimation::FitStatus::kUnexplained:
      return "no shape of the arm fits more than half of its tags" + check;
    case estimation::FitStatus::kUnderdetermined:
      break;
  }
  std::vector<int> tags;
  for (const estimation::PoseObservation& seen : capture.seen) tags.push_back(seen.tag);
  // Three points determine a section's twist, two in a plane; one pose counts as all of them.
  const int places = scene.vision.fit.planar ? 2 : 3;
  return whyUndetermined(scene, tags, scene.vision.fit.rotation_noise > 0 ? 1 : places);
}

void compareScatter(bool planar, std::vector<FittedCapture>& captures) {
  std::vector<std::optional<estimation::CaptureScatter>> scatter;
  for (const FittedCapture& capture : captures) {
    scatter.emplace_back();
    if (capture.converged()) scatter.back() = procedures::scatterOfPoses(*capture.fit, planar);
  }
  const estimation::CaptureCheck check = estimation::checkCaptures(scatter);
  for (std::size_t i = 0; i < captures.size(); ++i) {
    if (check.apart[i]) captures[i].usual_rms = check.usual;
  }
}

}  // namespace

void requirePressureDriven(const io::Scene& scene) {
  if (!hasTendon(scene.arm)) return;
  throw CallerError("scene " + scene.name +
                    " has tendons, but the data set gives pressures; expected a scene whose "
                    "actuators are all driven by pressure");
}

const char* modelTier(const io::Scene& scene) {
  return statics::nameOf(scene.model.choice().setting.tier);
}

std::string reasonForNoShape(statics::SolveStatus status) {
  if (status == statics::SolveStatus::kUnsupported) {
    return "the load pulls along a motion that no actuator resists";
  }
  if (status == statics::SolveStatus::kSnapped) {
    return "the shapes that grow from the unloaded one end at a smaller load, and the arm may snap "
           "to several others; lower the load, or raise arm.stiffness.K_eps_n";
  }
  return "no shape that balances the load was found within the error that the tier states; less "
         "load, a higher order or tier: exact may help";
}

std::string noteOnStart(const statics::Solution& solution) {
  if (solution.converged()) return {};
  return "the search began at the shape without load: " + reasonForNoShape(solution.status);
}

std::vector<int> FittedCapture::outlierTags(const estimation::TagLayout& layout) const {
  std::vector<int> ids;
  if (!fit) return ids;
  for (const estimation::TagResidual& tag : fit->tags) {
    if (tag.outlier) ids.push_back(layout.tags[tag.tag].id);
  }
  std::sort(ids.begin(), ids.end());
  return ids;
}

std::vector<FittedCapture> fitCaptures(const io::Scene& scene, const io::DataSet& data) {
  if (!scene.tags) {
    throw CallerError(data.path + " holds tag poses, but scene " + scene.name +
                      " has no tags; expected a scene with a section tags");
  }
  requirePressureDriven(scene);
  estimation::TwistFitter fitter(*scene.tags, scene.arm.sectionCount(), scene.vision.fit);
  std::vector<FittedCapture> captures;
  for (const io::TagPoseCapture& measured :
       io::loadTagPoses(data, scene.arm.actuatorCount(), scene.X_BF)) {
    FittedCapture capture{measured.number, measured.pressure, {}, {}, {}, {}, {}, {}, {}};
    for (const io::TagPose& tag : measured.tags) {
      const int index = scene.tags->find(tag.id);
      if (index < 0) {
        capture.unknown_tags.push_back(tag.id);
      } else {
        capture.seen.push_back({index, tag.X_BT});
      }
    }
    const Eigen::VectorXd pressure = scene.arm.clamped(measured.pressure);
    capture.model = scene.model.solve(pressure);
    const estimation::TwistFit& fit =
        fitter.fitCold(capture.seen, statics::startingShape(scene.model, capture.model, pressure));
    capture.status = fit.status;
    capture.reason = reasonOf(scene, capture);
    if (fit.status == estimation::FitStatus::kConverged ||
        fit.status == estimation::FitStatus::kNotConverged) {
      capture.fit = fit;
    }
    captures.push_back(std::move(capture));
  }
  compareScatter(scene.vision.fit.planar, captures);
  return captures;
}

std::string noteOnScatter(const FittedCapture& capture) {
  if (!capture.usual_rms) return {};
  return procedures::scatterText(capture.fit->rms, *capture.usual_rms);
}

lie::SE3 measuredTip(const estimation::TwistFit& fit) {
  return fit.X_B0B * model::tipPose(fit.shape);
}

std::string reasonForNoFit(const std::vector<FittedCapture>& captures) {
  const auto any = [&captures](auto holds) {
    return std::any_of(captures.begin(), captures.end(), holds);
  };
  if (any([](const FittedCapture& capture) { return capture.sound(); })) return {};
  if (any([](const FittedCapture& capture) { return capture.converged(); })) {
    return "no capture is valid: each that could be fitted has tags that do not fit";
  }
  // The most frequent reason.
  std::map<std::string, int> counts;
  for (const FittedCapture& capture : captures) ++counts[capture.reason];
  const auto most =
      std::max_element(counts.begin(), counts.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  return "no capture could be fitted; " + std::to_string(most->second) + " of " +
         std::to_string(captures.size()) + ": " + most->first;
}

std::string whyUndetermined(const io::Scene& scene, const std::vector<int>& tags, int needed) {
  std::vector<int> counts(scene.looks.size());
  for (const int tag : tags) ++counts[scene.tags->tags[tag].section];
  std::string lacking;
  for (std::size_t k = 0; k < counts.size(); ++k) {
    if (counts[k] >= needed) continue;
    lacking += (lacking.empty() ? "" : ", ") + ("section " + scene.looks[k].name) + " has " +
               std::to_string(counts[k]) + (counts[k] == 1 ? " tag" : " tags") + " in sight";
  }
  if (!lacking.empty()) return lacking + "; expected at least " + std::to_string(needed);
  return "the visible tags do not determine the arm's shape; place tags farther apart and on "
         "different sides of the arm";
}

std::optional<double> median(std::vector<double> values) {
  if (values.empty()) return std::nullopt;
  return basics::medianOf(std::move(values));
}

std::string joined(const std::vector<int>& numbers) {
  std::string text;
  for (const int number : numbers) text += (text.empty() ? "" : " ") + std::to_string(number);
  return text;
}

}  // namespace helix_arm::cli
