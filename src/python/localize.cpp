#include <optional>
#include <sstream>

#include <opencv2/core.hpp>
#include <pybind11/stl.h>

#include "bindings.hpp"
#include "fit.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "parallel.hpp"

namespace helix_arm::python {
namespace {

// Gray pictures of one size.
struct Pictures {
  Pictures(const py::handle& given, const estimation::Camera& camera) {
    const bool bytes =
        py::isinstance<py::array>(given) &&
        py::reinterpret_borrow<py::array>(given).dtype().is(py::dtype::of<std::uint8_t>());
    if (!bytes) {
      throw py::type_error(
          "image is no array of bytes; expected a gray picture of dtype uint8, as "
          "of image.mean(axis=2).astype(np.uint8)");
    }
    const auto any = py::reinterpret_borrow<py::array>(given);
    const py::ssize_t n = any.ndim();
    const bool fits =
        (n == 2 || n == 3) && any.shape(n - 2) == camera.height && any.shape(n - 1) == camera.width;
    if (!fits) {
      std::ostringstream message;
      message << "image has shape " << shapeText(any) << "; expected gray pictures of the scene's "
              << "camera: (" << camera.height << ", " << camera.width << ") or (N, "
              << camera.height << ", " << camera.width << ")";
      throw py::value_error(message.str());
    }
    single = n == 2;
    count = single ? 1 : any.shape(0);
    array = py::array_t<std::uint8_t, py::array::c_style>(any);
    height = camera.height;
    width = camera.width;
  }
  cv::Mat at(py::ssize_t i) const {
    auto* const first = const_cast<std::uint8_t*>(array.data()) + i * height * width;
    return cv::Mat(height, width, CV_8UC1, first);
  }

  py::array_t<std::uint8_t, py::array::c_style> array;
  bool single;
  py::ssize_t count;
  int height, width;
};

py::array cornersOf(const std::vector<vision::TagDetection>& tags) {
  py::array_t<double> out(std::vector<py::ssize_t>{static_cast<py::ssize_t>(tags.size()), 4, 2});
  double* to = out.mutable_data();
  for (const vision::TagDetection& tag : tags) {
    for (int k = 0; k < 4; ++k) {
      *to++ = tag.corners(0, k);
      *to++ = tag.corners(1, k);
    }
  }
  return out;
}

py::list localize(const Scene& self, const py::object& image, const py::object& pressures) {
  const io::Scene& scene = self.scene();
  basics::require(scene.camera && scene.tags, "localize() needs camera and tags, but scene ",
                  scene.name, " lacks one; expected a scene with sections camera and tags");
  const Pictures pictures(image, scene.camera->model);
  const py::object at = pressures.is_none() ? vectorOf(scene.arm.inputAt(0)) : pressures;
  const Rows inputs = self.inputs(at, "pressures_pa");
  basics::require(inputs.single() || inputs.rows() == pictures.count, "pressures_pa has ",
                  inputs.rows(), " rows; expected one per picture: ", pictures.count);
  self.requireWithinLimits(inputs);

  vision::ArmLocalizer localizer(scene.view(), scene.vision);
  Eigen::VectorXd q;
  py::list out;
  for (py::ssize_t i = 0; i < pictures.count; ++i) {
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    const cv::Mat picture = pictures.at(i);
    self.copyRow(inputs, inputs.single() ? 0 : i, &q);
    const vision::Observation* observation = nullptr;
    {
      const OthersRun others_run;
      observation =
          &localizer.locate(picture, statics::startingShape(scene.model, scene.model.solve(q), q));
    }
    const bool measured = observation->state == vision::ObservationState::kMeasured;
    FitArrays arrays(scene.arm.sectionCount(), 1);
    if (measured) arrays.set(0, observation->fit);
    std::vector<int> ids;
    for (const vision::TagDetection& tag : observation->detections) ids.push_back(tag.id);
    const py::int_ first(0);
    py::dict one;
    one["state"] = vision::nameOf(observation->state);
    one["twists"] = arrays.twists[first];
    one["covariance"] = arrays.covariances[first];
    one["tip"] = arrays.tips[first];
    one["quaternion_xyzw"] = arrays.quaternions[first];
    one["tip_covariance"] = arrays.tip_covariances[first];
    one["rms_px"] = arrays.rms.at(0);
    one["tags"] = copyOf(ids.data(), {static_cast<py::ssize_t>(ids.size())});
    one["corners_px"] = cornersOf(observation->detections);
    one["outlier_tags"] = measured ? outliersOf(observation->fit, *scene.tags) : py::list();
    one["unknown_tags"] = observation->unknown_ids;
    one["repeated_tags"] = observation->repeated_ids;
    out.append(one);
  }
  return out;
}

}  // namespace

void bindLocalize(py::class_<Scene>& scene) {
  scene.def("_localize", localize, py::arg("image"), py::arg("pressures_pa"));
}

}  // namespace helix_arm::python
