#include "helix_arm/model/taper.hpp"

#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::model {
namespace {

template <class Group>
void checkStrands(const std::vector<Strand<Group>>& strands) {
  basics::require(!strands.empty() && strands.size() <= kMaxActuators, "a section has ",
                  strands.size(), " actuators; expected 1 to ", kMaxActuators);
  for (std::size_t i = 0; i < strands.size(); ++i) {
    const auto& [X_O, K] = strands[i];
    basics::require(X_O.rotation.allFinite() && X_O.translation.allFinite(), "actuator ", i + 1,
                    " has a pose that is not finite");
    basics::require(K.allFinite() && (K.array() >= 0).all() && K[0] > 0, "actuator ", i + 1,
                    " has a stiffness that is not finite and >= 0, or no extensional stiffness");
  }
}

// Length that scales bending against shear: distance of the actuators from the base curve or, if
// this vanishes, that which corresponds to their own bending stiffness.
template <class Group>
double characteristicLength(const std::vector<Strand<Group>>& strands) {
  double offset = 0.0, bending = 0.0;
  for (const auto& [X_O, K] : strands) {
    offset += X_O.translation.squaredNorm() / static_cast<double>(strands.size());
    bending = std::max(bending, K.template tail<Group::kRotations>().maxCoeff());
  }
  const double length = std::max(std::sqrt(offset), 1e-6 * std::sqrt(bending));
  return length > 0 ? length : 1.0;
}

// Rows K_i^1/2 Ad_oi^-1 S^-1 of all strands, and K_i^1/2 e1 by their free lengths.
struct StrandRows {
  Eigen::MatrixXd by_twist, by_length;
};

// Largest rows first: with column pivoting, small rows keep their digits if K_gamma >> K_kappa.
template <class Group>
StrandRows sortedRows(const std::vector<Strand<Group>>& strands,
                      const typename Group::Tangent& S_inverse) {
  constexpr int dof = Group::kDof;
  const int n = static_cast<int>(strands.size());
  Eigen::MatrixXd stack(n * dof, dof);
  for (int i = 0; i < n; ++i) {
    const auto& [X_O, K] = strands[i];
    stack.middleRows<dof>(i * dof) =
        K.cwiseSqrt().asDiagonal() * X_O.inverse().adjoint() * S_inverse.asDiagonal();
  }
  std::vector<int> order(n * dof);
  std::iota(order.begin(), order.end(), 0);
  const Eigen::VectorXd size = stack.rowwise().template lpNorm<Eigen::Infinity>();
  std::stable_sort(order.begin(), order.end(), [&size](int a, int b) { return size[a] > size[b]; });
  StrandRows out{Eigen::MatrixXd(n * dof, dof), Eigen::MatrixXd::Zero(n * dof, n)};
  for (int row = 0; row < n * dof; ++row) {
    out.by_twist.row(row) = stack.row(order[row]);
    const int i = order[row] / dof;
    if (order[row] % dof == 0) out.by_length(row, i) = std::sqrt(strands[i].K[0]);
  }
  return out;
}

constexpr int kLeastModes = 6, kMostModes = 24;
constexpr double kFitError = 1e-9;  // of the maps and compliances, relative to their largest entry

template <class Group>
Equilibrium<Group> balanceAt(const std::vector<ActuatorOf<Group>>& actuators, double s) {
  std::vector<Strand<Group>> strands;
  for (const ActuatorOf<Group>& actuator : actuators) {
    strands.push_back({poseAlong(actuator, s), actuator.stiffness.template diagonal<Group>()});
  }
  return solveEquilibrium(strands);
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
Equilibrium<Group> solveEquilibrium(const std::vector<Strand<Group>>& strands) {
  constexpr int dof = Group::kDof;
  checkStrands(strands);
  const int n = static_cast<int>(strands.size());

  // Unknowns S g: with angles scaled to arc lengths, all are lengths, and bending is no noise.
  typename Group::Tangent S_inverse = Group::Tangent::Ones();
  S_inverse.template tail<Group::kRotations>().setConstant(1.0 / characteristicLength(strands));

  const auto [sorted, rest_length] = sortedRows(strands, S_inverse);

  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(sorted);
  const int rank = static_cast<int>(qr.rank());
  const Eigen::MatrixXd R = qr.matrixR().topRows(dof).template triangularView<Eigen::Upper>();
  const auto R11 = R.topLeftCorner(rank, rank).template triangularView<Eigen::Upper>();
  Eigen::MatrixXd permuted = Eigen::MatrixXd::Zero(dof, n);
  permuted.topRows(rank) = R11.solve((qr.householderQ().adjoint() * rest_length).topRows(rank));

  Equilibrium<Group> result;
  result.rank = rank;
  result.map = S_inverse.asDiagonal() * (qr.colsPermutation() * permuted);
  Eigen::MatrixXd R11_inverse = Eigen::MatrixXd::Zero(dof, rank);
  R11_inverse.topRows(rank) = R11.solve(Eigen::MatrixXd::Identity(rank, rank));
  const Eigen::MatrixXd factor = S_inverse.asDiagonal() * (qr.colsPermutation() * R11_inverse);
  result.compliance = factor * factor.transpose();
  const Eigen::VectorXd sigma = Eigen::JacobiSVD<Eigen::MatrixXd>(R.topRows(rank)).singularValues();
  result.condition = std::pow(sigma[0] / sigma[rank - 1], 2);
  result.null_space.resize(dof, dof - rank);
  if (rank < dof) {
    Eigen::MatrixXd basis(dof, dof - rank);
    basis << -R11.solve(R.topRightCorner(rank, dof - rank)),
        Eigen::MatrixXd::Identity(dof - rank, dof - rank);
    basis = S_inverse.asDiagonal() * (qr.colsPermutation() * basis);
    const Eigen::HouseholderQR<Eigen::MatrixXd> orthonormal(basis);
    result.null_space = orthonormal.householderQ() * Eigen::MatrixXd::Identity(dof, dof - rank);
    // Least norm in the units of g, as the pseudo-inverse of eq. 17 means it.
    const typename Group::Matrix range =
        Group::Matrix::Identity() - result.null_space * result.null_space.transpose();
    result.map = (range * result.map).eval();
    result.compliance = (range * result.compliance * range).eval();
  }
  return result;
}

template Equilibrium<lie::SE2> solveEquilibrium(const std::vector<Strand<lie::SE2>>& strands);
template Equilibrium<lie::SE3> solveEquilibrium(const std::vector<Strand<lie::SE3>>& strands);

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
