#include <limits>
#include <optional>
#include <string>

#include <pybind11/stl.h>

#include "bindings.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/procedures/follow_run.hpp"

namespace helix_arm::python {
namespace {

using procedures::FollowPlan;
using procedures::FollowResult;
using procedures::FollowRow;

constexpr model::Range kSeconds{0.1, 3600};
constexpr model::Range kLatency{0, 1};
constexpr py::ssize_t kMostTips = 1000;
constexpr double kMostForce = 100.0;  // [N]
constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();

std::vector<Eigen::Vector3d> tipsOf(const py::object& given, double seconds) {
  const Rows rows(given, "tips", 3);
  basics::require(rows.rows() >= 1 && rows.rows() <= kMostTips, "tips has ", rows.rows(),
                  " rows; expected 1 to ", kMostTips);
  requireFinite(rows);
  const double least = procedures::kLeastTipTime * static_cast<double>(rows.rows());
  basics::require(seconds >= least, "seconds is ", seconds, ", too short for ", rows.rows(),
                  " tips; expected at least 1 s for each");
  std::vector<Eigen::Vector3d> out;
  for (py::ssize_t i = 0; i < rows.rows(); ++i) {
    out.emplace_back(rows.row(i));
    basics::require(out.back().cwiseAbs().maxCoeff() <= statics::kFarthestTarget,
                    "tips is farther than 1e6 m in row ", i, "; expected metres from the base");
  }
  return out;
}

control::TipPath pathOf(const py::object& given, const io::Scene& scene) {
  const Rows rows(given, "path", 4);
  constexpr auto kFewest = static_cast<py::ssize_t>(control::kFewestWayPoints);
  constexpr auto kMost = static_cast<py::ssize_t>(control::kMostWayPoints);
  basics::require(rows.rows() >= kFewest && rows.rows() <= kMost, "path has ", rows.rows(),
                  " rows; expected ", kFewest, " to ", kMost);
  requireFinite(rows);
  std::vector<control::TipWayPoint> points;
  for (py::ssize_t i = 0; i < rows.rows(); ++i) {
    points.push_back({rows(i, 0), {rows(i, 1), rows(i, 2), rows(i, 3)}});
  }
  control::TipPath path(points);
  const auto refusal = procedures::checkPath(scene, path);
  basics::require(!refusal, "path: ", refusal ? refusal->reason : "");
  return path;
}

Eigen::VectorXd numbersOf(const py::object& given, const char* name, py::ssize_t count) {
  const Rows row(given, name, count);
  basics::require(row.rows() == 1, name, " has ", row.rows(), " rows; expected one");
  requireFinite(row);
  return row.row(0);
}

FollowPlan planOf(const io::Scene& scene, const py::object& tips, const py::object& path,
                  double seconds, bool open, const std::string& vision, const py::object& force,
                  const py::object& blind, double latency, std::uint32_t seed) {
  basics::require(tips.is_none() != path.is_none(),
                  "follow() needs either tips or path; expected exactly one");
  basics::require(kSeconds.contains(seconds), "seconds is ", seconds, "; expected ", kSeconds.lower,
                  " to ", kSeconds.upper);
  basics::require(kLatency.contains(latency), "latency_s is ", latency, "; expected 0 to 1");
  basics::require(vision == "corners" || vision == "rendered", "sight is \"", vision.substr(0, 40),
                  "\"; expected corners or rendered");
  FollowPlan plan;
  plan.seconds = seconds;
  plan.open = open;
  if (vision == "rendered") plan.vision = simulation::VisionKind::kRendered;
  plan.latency = latency;
  plan.seed = seed;
  if (!tips.is_none()) plan.tips = tipsOf(tips, seconds);
  if (!path.is_none()) plan.path = pathOf(path, scene);
  if (!force.is_none()) {
    const Eigen::VectorXd numbers = numbersOf(force, "force", 4);
    basics::require(numbers.tail<3>().norm() <= kMostForce,
                    "force is more than 100 N; expected time, x, y, z in s and N");
    plan.force = procedures::TimedForce{numbers[0], numbers.tail<3>()};
  }
  if (!blind.is_none()) {
    const Eigen::VectorXd times = numbersOf(blind, "blind", 2);
    basics::require(times[0] <= times[1], "blind ends at ", times[1], " before it begins at ",
                    times[0], "; expected from, to [s]");
    plan.blind = model::Range{times[0], times[1]};
  }
  return plan;
}

// A column of positions; NaN where there is none.
template <class Get>
py::array positionsOf(const std::vector<FollowRow>& rows, const Get& get) {
  py::array_t<double> out({static_cast<py::ssize_t>(rows.size()), py::ssize_t{3}});
  double* to = out.mutable_data();
  for (const FollowRow& row : rows) {
    const std::optional<Eigen::Vector3d> position = get(row);
    Eigen::Vector3d::Map(to) = position.value_or(Eigen::Vector3d::Constant(kNoNumber));
    to += 3;
  }
  return out;
}

template <class Value, class Get>
py::array columnOf(const std::vector<FollowRow>& rows, const Get& get) {
  py::array_t<Value> out(static_cast<py::ssize_t>(rows.size()));
  Value* to = out.mutable_data();
  for (const FollowRow& row : rows) *to++ = get(row);
  return out;
}

py::list alarmsOf(const FollowResult& result) {
  py::list out;
  for (const procedures::FollowAlarm& alarm : result.alarms) {
    py::dict one;
    one["time_s"] = alarm.time;
    one["onset_s"] = alarm.onset;
    one["force_n"] = vectorOf(alarm.force);
    one["covariance"] = matrixOf(alarm.covariance);
    one["normalised"] = alarm.normalised;
    out.append(one);
  }
  return out;
}

py::dict resultOf(const FollowResult& result, int actuators) {
  const std::vector<FollowRow>& rows = result.rows;
  py::dict out;
  out["times_s"] = columnOf<double>(rows, [](const FollowRow& row) { return row.time; });
  out["wanted_tips"] = positionsOf(rows, [](const FollowRow& row) { return row.wanted; });
  out["true_tips"] =
      positionsOf(rows, [](const FollowRow& row) { return std::optional(row.true_tip); });
  out["measured_tips"] = positionsOf(rows, [](const FollowRow& row) { return row.measured; });
  out["measured_times_s"] = columnOf<double>(
      rows, [](const FollowRow& row) { return row.measured ? row.measured_time : kNoNumber; });
  out["predicted_tips"] = positionsOf(rows, [](const FollowRow& row) { return row.predicted; });
  Eigen::MatrixXd pressures(static_cast<Eigen::Index>(rows.size()), actuators);
  py::list states;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    pressures.row(static_cast<Eigen::Index>(i)) = rows[i].pressure;
    states.append(follow::nameOf(rows[i].state));
  }
  out["pressures_pa"] = matrixOf(pressures);
  out["states"] = textsOf(states);
  out["path_times_s"] = columnOf<double>(
      rows, [](const FollowRow& row) { return row.path_time.value_or(kNoNumber); });
  out["unreachable"] = columnOf<bool>(rows, [](const FollowRow& row) { return row.unreachable; });
  out["load_scores"] = columnOf<double>(rows, [](const FollowRow& row) { return row.load_score; });
  out["path_rms_m"] = result.figures.path_rms;
  out["path_max_m"] = result.figures.path_max;
  out["steady_rms_m"] = result.figures.steady_rms;
  out["settle_s"] = result.figures.settle;
  out["alarms"] = alarmsOf(result);
  out["pictures"] = result.pictures;
  out["vented"] = result.vented;
  return out;
}

py::dict follow(const Scene& self, const py::object& tips, const py::object& path,
                const py::object& seconds, const py::object& open, const py::object& vision,
                const py::object& force, const py::object& blind, const py::object& latency_s,
                const py::object& seed, const py::object& rig) {
  const FollowPlan plan =
      planOf(self.scene(), tips, path, numberOf(seconds, "seconds"), flagOf(open, "open"),
             textOf(vision, "sight"), force, blind, numberOf(latency_s, "latency_s"),
             static_cast<std::uint32_t>(
                 integerOf(seed, "seed", 0, std::numeric_limits<std::uint32_t>::max())));
  if (!rig.is_none() && !py::isinstance<Scene>(rig)) refuseType(rig, "rig", "a Scene or None");
  const Scene& truth = rig.is_none() ? self : rig.cast<const Scene&>();
  bool interrupted = false;
  FollowResult result;
  {
    OthersRun others_run;
    const auto progress = [&](double) {
      interrupted = others_run.interrupted();
      return !interrupted;
    };
    result = procedures::runFollow(self.scene(), truth.scene(), plan, progress);
  }
  if (interrupted) throw py::error_already_set();
  return resultOf(result, self.arm().actuatorCount());
}

}  // namespace

void bindFollow(py::class_<Scene>& scene) {
  scene.def("_follow", follow, py::arg("tips"), py::arg("path"), py::arg("seconds"),
            py::arg("open"), py::arg("sight"), py::arg("force"), py::arg("blind"),
            py::arg("latency_s"), py::arg("seed"), py::arg("rig"));
}

}  // namespace helix_arm::python
