#pragma once

#include "scene.hpp"

/// The methods of Scene, one function per file. Those whose names begin with _ return a dict with
/// the fields of a dataclass of helix_arm.results.
namespace helix_arm::python {

void bindForward(py::module_& module, py::class_<Scene>& scene);
void bindCalibrate(py::class_<Scene>& scene);
void bindCurve(py::class_<Scene>& scene);
void bindFit(py::class_<Scene>& scene);
void bindFollow(py::class_<Scene>& scene);
void bindInverse(py::class_<Scene>& scene);
void bindJacobian(py::class_<Scene>& scene);
void bindLocalize(py::class_<Scene>& scene);
void bindWorkspace(py::class_<Scene>& scene);

}  // namespace helix_arm::python
