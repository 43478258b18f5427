#include "helix_arm/model/taper.hpp"

#include <algorithm>
#include <cmath>

#include "basics/pi.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::model {
namespace {

constexpr int kLeastModes = 6, kMostModes = 24;
constexpr double kFitError = 1e-9;  // of the maps and compliances, relative to their largest entry

template <class Group>
Equilibrium<Group> balanceAt(const std::vector<ActuatorOf<Group>>& actuators, double s) {
  std::vector<ActuatorElement<Group>> elements;
  for (const ActuatorOf<Group>& actuator : actuators) {
    elements.push_back({poseAlong(actuator, s), actuator.stiffness.template diagonal<Group>()});
  }
  return solveEquilibrium(elements);
}

// sum_k c_k T_k(2 t - 1) by Clenshaw's recurrence. @param mode  c_k by k.
template <class Value, class Mode>
Value chebyshev(const Mode& mode, int count, double t) {
  const double x = 2.0 * t - 1.0;
  Value next = mode(count - 1), after = Value::Zero(next.rows(), next.cols());
  for (int k = count - 2; k > 0; --k) {
    const Value here = mode(k) + 2.0 * x * next - after;
    after = next;
    next = here;
  }
  return mode(0) + x * next - after;
}
template <class Value>
Value chebyshev(const Value* modes, int count, double t) {
  return chebyshev<Value>([modes](int k) -> const Value& { return modes[k]; }, count, t);
}

// Coefficients of the polynomial through values at the Chebyshev points.
template <class Value>
std::vector<Value> modesOf(const std::vector<Value>& values) {
  const int count = static_cast<int>(values.size());
  std::vector<Value> out;
  for (int k = 0; k < count; ++k) {
    Value sum = Value::Zero(values.front().rows(), values.front().cols());
    for (int j = 0; j < count; ++j)
      sum += std::cos(basics::kPi * k * (j + 0.5) / count) * values[j];
    out.push_back((k == 0 ? 1.0 : 2.0) / count * sum);
  }
  return out;
}

// Largest difference of two maps (dof x n), relative to the largest entry of the rows of one unit.
template <class Group, class Map>
double mapsApart(const Map& found, const Map& expected) {
  const auto worst = [&](auto rows) {
    return (found(rows, Eigen::all) - expected(rows, Eigen::all)).cwiseAbs().maxCoeff() /
           expected(rows, Eigen::all).cwiseAbs().maxCoeff();
  };
  return std::max(worst(Eigen::seqN(0, Group::kSpace)),
                  worst(Eigen::seqN(Group::kSpace, Group::kRotations)));
}

// Largest difference of two compliances (dof x dof), relative to the largest entry that their
// diagonals allow among the entries of one unit: symmetry makes whole blocks of them 0.
template <class Group, class Matrix>
double compliancesApart(const Matrix& found, const Matrix& expected) {
  const auto diagonal = expected.diagonal();
  const double along = std::sqrt(diagonal.template head<Group::kSpace>().maxCoeff()),
               about = std::sqrt(diagonal.template tail<Group::kRotations>().maxCoeff());
  typename Group::Tangent scale;
  scale.template head<Group::kSpace>().setConstant(along);
  scale.template tail<Group::kRotations>().setConstant(about);
  return ((found - expected).cwiseAbs().array() / (scale * scale.transpose()).array()).maxCoeff();
}

struct CellPlace {
  int cell;
  double t;  // in [0, 1] of the cell
};

CellPlace placeOf(double s, int cells) {
  const int cell = std::clamp(static_cast<int>(s * cells), 0, cells - 1);
  return {cell, s * cells - cell};
}

// Number of cells between the poses that all tapered actuators give.
template <class Group>
int cellsOf(const std::vector<ActuatorOf<Group>>& actuators) {
  int out = 0;
  for (const ActuatorOf<Group>& actuator : actuators) {
    const int cells = static_cast<int>(actuator.taper.size()) - 1;
    if (cells < 1) continue;
    basics::require(out == 0 || cells == out, actuator.name, " has ", cells + 1,
                    " poses along the section; expected ", out + 1, ", as another actuator has");
    out = cells;
  }
  basics::require(out <= kMostCells, "a taper of ", out + 1, " poses; expected at most ",
                  kMostCells + 1);
  return std::max(out, 1);
}

}  // namespace

template <class Group>
Group poseAlong(const ActuatorOf<Group>& actuator, double s) {
  if (actuator.taper.empty()) return actuator.X_O;
  const auto [cell, t] = placeOf(s, static_cast<int>(actuator.taper.size()) - 1);
  const Group &from = actuator.taper[cell], &to = actuator.taper[cell + 1];
  Group turn;
  turn.rotation = from.rotation.transpose() * to.rotation;
  return {from.rotation * Group::exp(t * turn.log()).rotation,
          (1.0 - t) * from.translation + t * to.translation};
}

template <class Group>
double TaperOf<Group>::fit(const std::vector<ActuatorOf<Group>>& actuators, int modes) {
  modes_ = modes;
  map_modes_.clear();
  compliance_modes_.clear();
  for (int cell = 0; cell < cells_; ++cell) {
    std::vector<Map> maps;
    std::vector<Matrix> compliances;
    for (int j = 0; j < modes; ++j) {
      const double t = 0.5 * (1.0 + std::cos(basics::kPi * (j + 0.5) / modes));
      const Equilibrium<Group> at = balanceAt(actuators, (cell + t) / cells_);
      mean_.rank = std::min(mean_.rank, at.rank);
      mean_.condition = std::max(mean_.condition, at.condition);
      maps.push_back(at.map);
      compliances.push_back(at.compliance);
    }
    for (const Map& mode : modesOf(maps)) map_modes_.push_back(mode);
    for (const Matrix& mode : modesOf(compliances)) compliance_modes_.push_back(mode);
  }
  double worst = 0.0;
  // Between the points of the fit, and at the ends, where its error is largest.
  for (int i = 0; i <= 8 * cells_; ++i) {
    const double s = std::clamp(i / (8.0 * cells_), 0.0, 1.0);
    const Equilibrium<Group> at = balanceAt(actuators, s);
    worst = std::max({worst, mapsApart<Group>(mapAt(s), at.map),
                      compliancesApart<Group>(complianceAt(s), at.compliance)});
  }
  return worst;
}

template <class Group>
TaperOf<Group>::TaperOf(const std::vector<ActuatorOf<Group>>& actuators)
    : cells_(cellsOf(actuators)) {
  mean_ = balanceAt(actuators, 0.5);
  double error = fit(actuators, kLeastModes);
  while (error > kFitError && modes_ < kMostModes) error = fit(actuators, 2 * modes_);
  basics::require(mean_.rank == Group::kDof,
                  "a tapered section has a motion that no actuator resists; give K_tau and K_kappa "
                  "values > 0");
  basics::require(error <= kFitError,
                  "the taper is too steep: its equilibrium is no polynomial of s to 1e-9; expected "
                  "ends that differ by less, or more values in between");
  mean_.map.setZero();
  mean_.compliance.setZero();
  // Exact for the polynomials: the mean of T_k over a cell is 1 / (1 - k^2) for even k, 0 for odd.
  for (int cell = 0; cell < cells_; ++cell) {
    for (int k = 0; k < modes_; k += 2) {
      const double weight = 1.0 / (1.0 - static_cast<double>(k) * k) / cells_;
      mean_.map += weight * map_modes_[cell * modes_ + k];
      mean_.compliance += weight * compliance_modes_[cell * modes_ + k];
    }
  }
}

template <class Group>
typename TaperOf<Group>::Map TaperOf<Group>::mapAt(double s) const {
  const auto [cell, t] = placeOf(s, cells_);
  return chebyshev(&map_modes_[cell * modes_], modes_, t);
}

template <class Group>
typename TaperOf<Group>::Matrix TaperOf<Group>::complianceAt(double s) const {
  const auto [cell, t] = placeOf(s, cells_);
  return chebyshev(&compliance_modes_[cell * modes_], modes_, t);
}

template <class Group>
typename TaperOf<Group>::Step TaperOf<Group>::step(double from, double to) const {
  const Map zero = Map::Zero(Group::kDof, mean_.map.cols());
  return {magnusTerms(from, to, cells_, zero, [this](double s) { return mapAt(s); })};
}

template <class Group>
TaperTwist<Group>::TaperTwist(const TaperOf<Group>& taper,
                              const typename TaperOf<Group>::Lengths& lengths)
    : cells_(taper.cells_), modes_(taper.modes_), g_modes_(Group::kDof, cells_ * modes_) {
  for (int k = 0; k < g_modes_.cols(); ++k) g_modes_.col(k) = taper.map_modes_[k] * lengths;
}

template <class Group>
typename Group::Tangent TaperTwist<Group>::at(double s) const {
  const auto [cell, t] = placeOf(s, cells_);
  return chebyshev<Tangent>(
      [this, first = cell * modes_](int k) { return g_modes_.col(first + k); }, modes_, t);
}

template <class Group>
typename Group::Tangent TaperTwist<Group>::step(double from, double to) const {
  const Tangent zero = Tangent::Zero();
  return magnusTwist(magnusTerms(from, to, cells_, zero, [this](double s) { return at(s); }));
}

template lie::SE2 poseAlong(const PlanarActuator&, double);
template lie::SE3 poseAlong(const Actuator&, double);
template class TaperOf<lie::SE2>;
template class TaperOf<lie::SE3>;
template class TaperTwist<lie::SE2>;
template class TaperTwist<lie::SE3>;

}  // namespace helix_arm::model
