#include "scene.hpp"

#include <algorithm>
#include <iterator>
#include <sstream>
#include <utility>

#include "helix_arm/control/target_check.hpp"

namespace helix_arm::python {
namespace {

constexpr std::size_t kMostKept = 64;

// Of the options that callers can choose.
bool same(const statics::InverseOptions& a, const statics::InverseOptions& b) {
  return a.preference == b.preference && a.cocontraction == b.cocontraction &&
         a.position_tolerance == b.position_tolerance;
}

// Rows of a batch that are judged for kPa, spread evenly: all would take as long as their tips.
constexpr py::ssize_t kJudgedRows = 64;

}  // namespace

Solvers::Solvers(const statics::ArmModel& model) : model_(model) {
  kept_.reserve(kMostKept);  // giving back does not allocate
}

Solvers::Loan Solvers::take(const statics::InverseOptions& options) {
  const auto give_back = [this, options](statics::InverseSolver* solver) {
    giveBack(options, std::unique_ptr<statics::InverseSolver>(solver));
  };
  {
    const basics::MutexLock lock(mutex_);
    const auto found = std::find_if(kept_.rbegin(), kept_.rend(), [&options](const Kept& one) {
      return same(one.options, options);
    });
    if (found != kept_.rend()) {
      Loan loan(nullptr, give_back);
      loan.reset(found->solver.release());
      kept_.erase(std::prev(found.base()));
      return loan;
    }
  }
  Loan loan(nullptr, give_back);
  loan.reset(new statics::InverseSolver(model_, options));
  ++made_;
  return loan;
}

void Solvers::giveBack(const statics::InverseOptions& options,
                       std::unique_ptr<statics::InverseSolver> solver) noexcept {
  std::unique_ptr<statics::InverseSolver> oldest;  // ends without the lock
  const basics::MutexLock lock(mutex_);
  if (kept_.size() == kMostKept) {
    oldest = std::move(kept_.front().solver);
    kept_.erase(kept_.begin());
  }
  kept_.push_back({options, std::move(solver)});
}

Scene::Scene(const std::string& path, const std::vector<io::Override>& overrides)
    : path_(path),
      overrides_(overrides),
      scene_(io::loadScene(path, overrides_)),
      solvers_(scene_.model) {
  for (int i = 0; i < arm().actuatorCount(); ++i) {
    if (model::unitOf(arm().actuator(i).drive).pressure) pressures_.push_back(i);
  }
}

Rows Scene::inputs(const py::handle& given, const char* name) const {
  Rows inputs(given, name, arm().actuatorCount());
  warnOfKilopascals(inputs);
  return inputs;
}

void Scene::warnOfKilopascals(const Rows& inputs) const {
  const py::ssize_t judged = std::min(inputs.rows(), kJudgedRows);
  const py::ssize_t step = judged > 1 ? (inputs.rows() - 1) / (judged - 1) : 1;
  bool any = false;
  for (py::ssize_t k = 0; k < judged; ++k) {
    for (const int i : pressures_) {
      const double pressure = inputs(k * step, i);
      // Rows of pascals are told by the first of them.
      if (!(pressure >= 0 && pressure < control::UnitWatch::kSuspicious)) return;
      any = any || pressure > 0;
    }
  }
  if (!any) return;
  // No value of the rows: Python shows a text once per place of the call.
  const std::string message =
      inputs.name() + " looks like kPa, as no pressure reaches " +
      std::to_string(static_cast<int>(control::UnitWatch::kSuspicious)) + " Pa in up to " +
      std::to_string(kJudgedRows) +
      " rows, evenly spread; expected gauge pressures in Pa, so 200 kPa are 200e3";
  if (PyErr_WarnEx(PyExc_UserWarning, message.c_str(), 2) != 0) throw py::error_already_set();
}

void Scene::requireWithinLimits(const Rows& inputs) const {
  const model::Arm& arm = this->arm();
  for (py::ssize_t i = 0; i < inputs.columns(); ++i) {
    const model::Actuator& actuator = arm.actuator(static_cast<int>(i));
    const model::Range limits = actuator.limits;
    for (py::ssize_t row = 0; row < inputs.rows(); ++row) {
      const double input = inputs(row, i);  // once, as others may write it
      if (limits.contains(input)) continue;
      const model::DriveUnit unit = model::unitOf(actuator.drive);
      std::ostringstream message;
      message.precision(12);
      message << inputs.name() << " asks " << actuator.name << " for " << input << " " << unit.si;
      if (!inputs.single()) message << " in row " << row;
      message << "; its limits are " << limits.lower << " to " << limits.upper << " " << unit.si
              << (unit.pressure ? " (gauge)" : "");
      throw std::invalid_argument(message.str());
    }
  }
}

void Scene::copyRow(const Rows& inputs, py::ssize_t row, Eigen::VectorXd* q) const {
  q->resize(inputs.columns());
  for (py::ssize_t i = 0; i < inputs.columns(); ++i) {
    (*q)[i] = inputs(row, i);
    if (!arm().actuator(static_cast<int>(i)).limits.contains((*q)[i])) inputs.refuseChange();
  }
}

}  // namespace helix_arm::python
