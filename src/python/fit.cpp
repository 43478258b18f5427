#include "fit.hpp"

#include <algorithm>
#include <variant>

#include <pybind11/stl.h>

#include "bindings.hpp"
#include "data.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/tag_poses.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "parallel.hpp"
#include "poses.hpp"

namespace helix_arm::python {

FitArrays::FitArrays(int sections, std::size_t count)
    : sections_(sections),
      twists(std::vector<py::ssize_t>{static_cast<py::ssize_t>(count), sections, 6}),
      covariances(
          std::vector<py::ssize_t>{static_cast<py::ssize_t>(count), 6 * sections, 6 * sections}),
      tips(std::vector<py::ssize_t>{static_cast<py::ssize_t>(count), 3}),
      quaternions(std::vector<py::ssize_t>{static_cast<py::ssize_t>(count), 4}),
      tip_covariances(std::vector<py::ssize_t>{static_cast<py::ssize_t>(count), 3, 3}),
      rms(static_cast<py::ssize_t>(count)) {
  for (py::array_t<double>* array :
       {&twists, &covariances, &tips, &quaternions, &tip_covariances, &rms}) {
    std::fill_n(array->mutable_data(), array->size(), std::numeric_limits<double>::quiet_NaN());
  }
}

void FitArrays::set(std::size_t row, const estimation::TwistFit& fit) {
  const int size = 6 * sections_;
  std::copy_n(fit.twists.data(), size, twists.mutable_data() + row * size);
  Eigen::MatrixXd::Map(covariances.mutable_data() + row * size * size, size, size) =
      fit.covariance;  // symmetric
  Eigen::Matrix3d::Map(tip_covariances.mutable_data() + 9 * row) = fit.tip_covariance;
  setPose(fit.X_B0B * model::tipPose(fit.shape), true, tips.mutable_data() + 3 * row,
          quaternions.mutable_data() + 4 * row);
  rms.mutable_at(static_cast<py::ssize_t>(row)) = fit.rms;
}

py::list outliersOf(const estimation::TwistFit& fit, const estimation::TagLayout& layout) {
  std::vector<int> ids;
  for (const estimation::TagResidual& tag : fit.tags) {
    if (tag.outlier) ids.push_back(layout.tags[static_cast<std::size_t>(tag.tag)].id);
  }
  std::sort(ids.begin(), ids.end());
  return py::cast(ids);
}

namespace {

// Pressures of tag poses outside the limits count as at them: they are but a start.
std::vector<estimation::Capture> capturesOf(const io::Scene& scene, const io::DataSet& data) {
  if (procedures::kindOf(data) != procedures::DataKind::kTagPoses) {
    return procedures::loadCaptures(scene, data).captures;
  }
  std::vector<estimation::Capture> out;
  for (const io::TagPoseCapture& capture :
       io::loadTagPoses(data, scene.arm.actuatorCount(), scene.X_BF)) {
    std::vector<estimation::PoseObservation> seen;
    for (const io::TagPose& tag : capture.tags) {
      const int index = scene.tags->find(tag.id);
      if (index >= 0) seen.push_back({index, tag.X_BT});
    }
    out.push_back({capture.number, scene.arm.clamped(capture.pressure), std::move(seen)});
  }
  return out;
}

py::dict fit(const Scene& self, const py::object& captures) {
  const io::Scene& scene = self.scene();
  basics::require(scene.tags.has_value(), "fit() needs tags, but scene ", scene.name,
                  " has none; expected a scene with a section tags");
  const std::vector<estimation::Capture> measured =
      capturesOf(scene, dataSetOf(captures, "captures"));
  basics::require(
      measured.empty() ||
          !std::holds_alternative<estimation::CurvatureReading>(measured.front().reading),
      "captures holds curvatures, which give no shape; expected tag poses or tag corners");

  FitArrays arrays(scene.arm.sectionCount(), measured.size());
  std::vector<int> numbers;
  std::vector<std::string> status;
  Eigen::MatrixXd pressures(static_cast<Eigen::Index>(measured.size()), scene.arm.actuatorCount());
  py::list outliers;
  estimation::TwistFitter fitter(*scene.tags, scene.arm.sectionCount(), scene.vision.fit);
  for (std::size_t i = 0; i < measured.size(); ++i) {
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    const estimation::Capture& capture = measured[i];
    numbers.push_back(capture.number);
    pressures.row(static_cast<Eigen::Index>(i)) = capture.pressure;
    const estimation::TwistFit* found = nullptr;
    {
      const OthersRun others_run;
      const model::Shape start = statics::startingShape(
          scene.model, scene.model.solve(capture.pressure), capture.pressure);
      if (const auto* poses =
              std::get_if<std::vector<estimation::PoseObservation>>(&capture.reading)) {
        found = &fitter.fitCold(*poses, start);
      } else {
        const auto& corners = std::get<std::vector<estimation::CornerObservation>>(capture.reading);
        found = &fitter.fitCold(corners, scene.X_CB(), scene.camera->model.focal(), start);
      }
    }
    status.emplace_back(estimation::nameOf(found->status));
    const bool fitted = found->status == estimation::FitStatus::kConverged ||
                        found->status == estimation::FitStatus::kNotConverged;
    if (fitted) arrays.set(i, *found);
    outliers.append(fitted ? outliersOf(*found, *scene.tags) : py::list());
  }
  py::dict out;
  out["captures"] = copyOf(numbers.data(), {static_cast<py::ssize_t>(numbers.size())});
  out["pressures_pa"] = matrixOf(pressures);
  out["status"] = textsOf(py::cast(status));
  out["twists"] = arrays.twists;
  out["covariances"] = arrays.covariances;
  out["tips"] = arrays.tips;
  out["quaternions_xyzw"] = arrays.quaternions;
  out["tip_covariances"] = arrays.tip_covariances;
  out["rms"] = arrays.rms;
  out["outlier_tags"] = outliers;
  return out;
}

}  // namespace

void bindFit(py::class_<Scene>& scene) { scene.def("_fit", fit, py::arg("captures")); }

}  // namespace helix_arm::python
