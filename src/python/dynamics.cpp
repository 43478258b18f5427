#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <pybind11/stl.h>

#include "bindings.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/dynamics/arm_motion.hpp"

namespace helix_arm::python {
namespace {

using dynamics::ArmMotion;
using dynamics::Beginning;
using dynamics::LinearMotion;

// @param order, step  in place of the scene's, unless None.
ArmMotion motionOf(const Scene& scene, std::optional<int> order, std::optional<double> step) {
  dynamics::MotionConfig config = scene.scene().dynamics;
  config.order = order.value_or(config.order);
  config.step = step.value_or(config.step);
  return {scene.arm(), scene.scene().planar, scene.model().load(), config};
}

// @param start  "rest", "straight", or coordinates and their rates (2, n).
Beginning beginningOf(const py::handle& start) {
  if (py::isinstance<py::str>(start)) {
    return start.cast<std::string>() == "rest" ? dynamics::Start::kRest
                                               : dynamics::Start::kStraight;
  }
  const py::array array = argumentArray(start, "start");
  basics::require(array.ndim() == 2 && array.shape(0) == 2, "start has ", array.ndim(),
                  array.ndim() == 1 ? " dimension" : " dimensions",
                  "; expected rest, straight, or coordinates and their rates (2, n)");
  const Rows rows(start, "start", array.shape(1));
  return dynamics::MotionState{rows.row(0), rows.row(1)};
}

std::array<double, 5> numbersOf(const dynamics::Energy& energy) {
  return {energy.kinetic, energy.elastic, energy.potential, energy.dissipated, energy.work};
}

// Motions of the tip, of one series of pressures (T, n) or one after the other (rollouts * T, n).
//
// @param times    (T,) ascending [s].
// @return tips, quaternions, energies (rollouts, 5) and steps (rollouts).
py::tuple motion(const Scene& scene, const py::handle& pressures, const std::vector<double>& times,
                 const py::handle& start, std::optional<int> order, std::optional<double> step,
                 std::size_t threads) {
  const Rows inputs = scene.inputs(pressures, "pressures_pa");
  const Beginning beginning = beginningOf(start);
  const auto rows = static_cast<py::ssize_t>(times.size()), rollouts = inputs.rows() / rows;
  py::array_t<double> tips({rollouts, rows, py::ssize_t{3}}),
      quaternions({rollouts, rows, py::ssize_t{4}}), energies({rollouts, py::ssize_t{5}});
  py::array_t<std::int64_t> steps(rollouts);
  double *const tip = tips.mutable_data(), *const quaternion = quaternions.mutable_data(),
                *const energy = energies.mutable_data();
  std::int64_t* const count = steps.mutable_data();
  {
    const OthersRun others_run;
    const ArmMotion arm = motionOf(scene, order, step);
    inPieces(static_cast<std::size_t>(rollouts), 1, threads,
             [&](std::size_t begin, std::size_t end) {
               dynamics::InputSeries series{times, {rows, inputs.columns()}};
               Eigen::VectorXd q;
               for (std::size_t r = begin; r < end; ++r) {
                 const auto first = static_cast<py::ssize_t>(r) * rows;
                 for (py::ssize_t i = 0; i < rows; ++i) {
                   scene.copyRow(inputs, first + i, &q);
                   series.input.row(i) = q;
                 }
                 const auto summary =
                     arm.follow(series, beginning, times, [&](std::size_t i, const auto& pose) {
                       const std::size_t at = static_cast<std::size_t>(first) + i;
                       setPose(pose, true, tip + 3 * at, quaternion + 4 * at);
                       return true;
                     });
                 const auto all = numbersOf(summary.energy);
                 std::copy_n(all.data(), 5, energy + 5 * r);
                 count[r] = summary.steps;
               }
             });
  }
  return py::make_tuple(tips, quaternions, energies, steps);
}

// An arm in motion, step by step. Of one thread at a time: calls keep the interpreter.
class Dynamics {
 public:
  Dynamics(const Scene& scene, std::optional<int> order, std::optional<double> step)
      : scene_(scene), motion_(motionOf(scene, order, step)), driver_(motion_.driver()) {}
  Dynamics(const Dynamics&) = delete;
  Dynamics& operator=(const Dynamics&) = delete;

  void start(const py::handle& pressures, const py::handle& start) {
    Eigen::VectorXd input = inputOf(pressures);
    driver_->start(input, beginningOf(start));
    input_ = std::move(input);
  }
  void step(const py::handle& pressures, double seconds) {
    Eigen::VectorXd next = inputOf(pressures);
    driver_->advance(seconds, input_, next);
    input_ = std::move(next);
  }
  // State (2, n), tip (3), quaternion (4), energies (5).
  py::tuple now() const {
    const dynamics::MotionState state = driver_->state();
    Eigen::MatrixXd both(2, state.position.size());
    both << state.position.transpose(), state.rate.transpose();
    Eigen::Vector3d tip;
    Eigen::Vector4d quaternion;
    setPose(driver_->tip(), true, tip.data(), quaternion.data());
    return py::make_tuple(arrayOf(both), arrayOf(tip), arrayOf(quaternion),
                          numbersOf(driver_->summary().energy));
  }
  py::dict linearised(const py::handle& pressures) const {
    const LinearMotion found = motion_.linearisedAt(inputOf(pressures));
    std::vector<double> frequencies, ratios;
    for (const dynamics::Vibration& one : dynamics::vibrationsOf(found)) {
      frequencies.push_back(one.frequency);
      ratios.push_back(one.damping);
    }
    return py::dict("mass"_a = arrayOf(found.mass), "damping"_a = arrayOf(found.damping),
                    "stiffness"_a = arrayOf(found.stiffness),
                    "by_input"_a = arrayOf(found.by_input), "tip_by"_a = arrayOf(found.tip_by),
                    "position"_a = arrayOf(found.position),
                    "tip"_a = arrayOf(found.tip.translation), "frequencies_hz"_a = frequencies,
                    "damping_ratios"_a = ratios);
  }

 private:
  Eigen::VectorXd inputOf(const py::handle& pressures) const {
    const Rows rows = scene_.inputs(pressures, "pressures_pa");
    basics::require(rows.rows() == 1, "pressures_pa has ", rows.rows(), " rows; expected one");
    Eigen::VectorXd input;
    scene_.copyRow(rows, 0, &input);
    return input;
  }

  const Scene& scene_;
  const ArmMotion motion_;
  const std::unique_ptr<dynamics::ArmDriver> driver_;
  Eigen::VectorXd input_;
};

}  // namespace

void bindDynamics(py::module_& module, py::class_<Scene>& scene) {
  scene.def("_motion", motion, "pressures_pa"_a, "times_s"_a, "start"_a, "order"_a, "step_s"_a,
            "threads"_a);
  py::class_<Dynamics>(module, "Dynamics")
      .def(py::init<const Scene&, std::optional<int>, std::optional<double>>(), "scene"_a,
           "order"_a, "step_s"_a, py::keep_alive<1, 2>())
      .def("start", &Dynamics::start, "pressures_pa"_a, "start"_a)
      .def("step", &Dynamics::step, "pressures_pa"_a, "seconds"_a)
      .def("now", &Dynamics::now)
      .def("linearised", &Dynamics::linearised, "pressures_pa"_a);
}

}  // namespace helix_arm::python
