#include <algorithm>
#include <limits>

#include <opencv2/core.hpp>
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include "bindings.hpp"
#include "helix_arm/model/curve.hpp"
#include "procedures/follow_run.hpp"
#include "response/mode_fit.hpp"
#include "simulation/rig.hpp"

namespace helix_arm::python {
namespace {

// @param targets  (rows x n) [Pa]; `looks` tells after which of them there is a picture.
// @return (rows x n + 6) readings [Pa], tips in the pictures, measured, NaN where the tip is not
// seen, and true [m].
Eigen::MatrixXd advance(procedures::SeenRig& self, const Scene& scene,
                        const Eigen::MatrixXd& targets, double dt, const std::vector<bool>& looks) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Constant(targets.rows(), targets.cols() + 6,
                                                  std::numeric_limits<double>::quiet_NaN());
  const OthersRun others_run;
  for (Eigen::Index row = 0; row < targets.rows(); ++row) {
    self.rig.command(targets.row(row).transpose());
    self.rig.step(dt);
    const Eigen::VectorXd reading = self.rig.measure();
    out.row(row).head(targets.cols()) = reading;
    if (!looks.at(static_cast<std::size_t>(row))) continue;
    out.row(row).tail<3>() = model::tipPose(self.rig.shape()).translation;
    const Eigen::VectorXd pressure = scene.arm().clamped(reading);
    const auto seen = self.vision.look(
        self.rig.shape(),
        statics::startingShape(scene.model(), scene.model().solve(pressure), pressure));
    if (seen) out.row(row).segment<3>(targets.cols()) = seen->tip.translation;
  }
  return out;
}

// Picture of the model at held pressures [Pa] by the scene's camera: (height x width) gray.
py::array_t<std::uint8_t> pictureOf(const Scene& scene, const Eigen::VectorXd& pressure) {
  const auto setup = scene.scene().cameraSetup();
  simulation::SimulatedCamera camera(setup->view, setup->family, setup->body, setup->config);
  const cv::Mat& gray =
      camera.render(statics::startingShape(scene.model(), scene.model().solve(pressure), pressure));
  return py::array_t<std::uint8_t>({gray.rows, gray.cols}, gray.data);
}

// @param time      (rows) [s]; one that goes back begins a trial.
// @param pressure  (rows x n) [Pa], or x 0; `position` (rows x 1 to 3) [m].
py::dict ringingOf(const std::vector<double>& time, const Eigen::MatrixXd& pressure,
                   const Eigen::MatrixXd& position) {
  std::vector<bool> begins(time.size());
  for (std::size_t i = 1; i < time.size(); ++i) begins[i] = time[i] < time[i - 1];
  const estimation::ModeFit fit = estimation::fitMode({pressure, time, begins}, position);
  const auto pairOf = [](const auto& one) { return std::pair(one.value, one.standard_error); };
  return py::dict("reason"_a = fit.failure, "frequency_hz"_a = pairOf(fit.frequency),
                  "damping"_a = pairOf(fit.damping), "all"_a = fit.rings.size(),
                  "found"_a = std::count_if(fit.rings.begin(), fit.rings.end(),
                                            [](const auto& one) { return one.found(); }));
}

}  // namespace

void bindExperiments(py::module_& module, py::class_<Scene>& scene) {
  py::class_<procedures::SeenRig>(module, "ExperimentRig")
      .def(py::init(
          [](const Scene& one, const Scene& rig, const std::string& plant, std::uint32_t seed) {
            return procedures::seenRigOf(one.scene(), rig.scene(), plant,
                                         simulation::VisionKind::kCorners, seed);
          }))
      .def("hang", [](procedures::SeenRig& self,
                      const Eigen::Vector3d& force) { self.rig.setTipForce(force); })
      .def("advance", &advance);
  module.def("picture", &pictureOf);
  module.def("_ringing", &ringingOf);
  // Whether it tells K_eps, which loads need.
  scene.def_property_readonly("_bends",
                              [](const Scene& self) { return self.model().load().has_value(); });
  scene.def_property_readonly("_rotation_WB", [](const Scene& self) {
    return Eigen::Matrix3d(self.scene().X_WB.rotation);
  });
  scene.def_property_readonly("_slew_pa_s", [](const Scene& self) {
    std::vector<double> out;
    for (const auto& channel : self.scene().safety.channels) out.push_back(channel.slew);
    return out;
  });
}

}  // namespace helix_arm::python
