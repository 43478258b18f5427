#include "linear_chain.hpp"

#include <Eigen/LU>

#include "wrench.hpp"

namespace helix_arm::statics {
namespace {

// Velocity of the point p per motion.
Eigen::Matrix<double, 3, 6> displacementOf(const Eigen::Vector3d& p) {
  Eigen::Matrix<double, 3, 6> out;
  out << Eigen::Matrix3d::Identity(), -lie::skew(p);
  return out;
}
Eigen::Matrix<double, 2, 3> displacementOf(const Eigen::Vector2d& p) {
  Eigen::Matrix<double, 2, 3> out;
  out << 1, 0, -p.y(), 0, 1, p.x();
  return out;
}

// momentOf(p, force) = momentsOf(force) p.
Eigen::Matrix3d momentsOf(const Eigen::Vector3d& force) { return -lie::skew(force); }
Eigen::RowVector2d momentsOf(const Eigen::Vector2d& force) { return {force.y(), -force.x()}; }

// ad_xi^T W = turned(W) xi.
lie::Matrix6 turned(const lie::Vector6& W) {
  lie::Matrix6 out;
  out << Eigen::Matrix3d::Zero(), lie::skew(W.head<3>()), lie::skew(W.head<3>()),
      lie::skew(W.tail<3>());
  return out;
}
Eigen::Matrix3d turned(const lie::SE2::Tangent& W) {
  Eigen::Matrix3d out;
  out << 0, 0, W.y(), 0, 0, -W.x(), -W.y(), W.x(), 0;
  return out;
}

}  // namespace

template <class Group>
LinearChain<Group>::LinearChain(const std::vector<LinearElement<Group>>& elements) {
  parts_.reserve(elements.size());
  for (const LinearElement<Group>& element : elements) parts_.push_back(partOf(element));
}

template <class Group>
typename LinearChain<Group>::Part LinearChain<Group>::partOf(const LinearElement<Group>& element) {
  constexpr int kDof = Group::kDof, kSpace = Group::kSpace;
  const int nodes = static_cast<int>(element.nodes.size());
  const int own = static_cast<int>(element.end.cols()), unknowns = kDof * nodes;
  const int start = unknowns, beyond = unknowns + kDof, all = unknowns + 2 * kDof + own;
  const auto motionOf = [&](const typename Group::Matrix& by_z, const auto& weights,
                            const Motion& by_own) {
    Motion out = Motion::Zero(kDof, all);
    for (int l = 0; l < nodes; ++l) {
      out.template middleCols<kDof>(kDof * l) = weights[l] * by_z;
    }
    out.template middleCols<kDof>(start).setIdentity();
    out.rightCols(own) = by_own;
    return out;
  };
  Part out{unknowns, element.first_column, own, Eigen::MatrixXd(unknowns, all), {}, {}};
  out.end = motionOf(element.end_by_z, element.weights, element.end);
  std::vector<Motion> motions;
  using Displacement = Eigen::Matrix<double, kSpace, Eigen::Dynamic>;
  std::vector<Displacement> moved;
  for (int j = 0; j < nodes; ++j) {
    const LinearNode<Group>& node = element.nodes[j];
    motions.push_back(motionOf(node.motion_by_z, element.before.col(j), node.motion));
    moved.push_back(displacementOf(node.X.translation) * motions[j]);
  }
  const auto addMoments = [&](const auto& weights, Motion& wrench) {
    Displacement sum = Displacement::Zero(kSpace, all);
    for (int l = 0; l < nodes; ++l) sum += weights[l] * moved[l];
    wrench.template bottomRows<Group::kRotations>() += momentsOf(element.weight) * sum;
  };
  out.wrench = Motion::Zero(kDof, all);
  out.wrench.template middleCols<kDof>(beyond).setIdentity();
  for (const auto& pull : element.pulls) {
    out.wrench.template bottomRows<Group::kRotations>() +=
        momentsOf(pull.force) * (displacementOf(pull.at) * out.end);
  }
  for (int j = 0; j < nodes; ++j) {
    const LinearNode<Group>& node = element.nodes[j];
    const typename Group::Matrix Ad_inverse = node.X.inverse().adjoint();
    // A motion turns the point against the wrench.
    const typename Group::Matrix by_wrench = node.rate_by_wrench * node.X.adjoint().transpose();
    const typename Group::Matrix by_motion = node.rate_by_wrench * turned(node.wrench) * Ad_inverse;
    Motion wrench = out.wrench;
    addMoments(element.after.col(j), wrench);
    auto rate = out.rates.template middleRows<kDof>(kDof * j);
    rate.noalias() = by_wrench * wrench;
    rate.noalias() += by_motion * motions[j];
    for (int l = 0; l < nodes; ++l) {
      rate.template middleCols<kDof>(kDof * l) += element.before(l, j) * node.rate_by_z;
    }
    rate.rightCols(own) += node.rate;
  }
  addMoments(element.weights, out.wrench);
  return out;
}

template <class Group>
typename LinearChain<Group>::Response LinearChain<Group>::balanced(const Motion& at_tip) const {
  constexpr int kDof = Group::kDof;
  using Matrix = typename Group::Matrix;
  // Of each element, with its own rates eliminated.
  struct Reduced {
    Eigen::MatrixXd rates;
    Motion end, wrench;
    // With all elements beyond: motion of the end by that of the start; wrench beyond the end by
    // the motion there.
    Matrix end_by_start, beyond_by_end;
    Motion end_own, beyond_own;  // the same by all parameters
  };
  const int count = static_cast<int>(parts_.size());
  std::vector<Reduced> reduced(parts_.size());
  Matrix P = Matrix::Zero();
  Motion Q = at_tip;
  for (int e = count - 1; e >= 0; --e) {
    const Part& part = parts_[e];
    const int unknowns = part.unknowns, others = 2 * kDof + part.columns;
    Reduced& r = reduced[e];
    r.rates = (Eigen::MatrixXd::Identity(unknowns, unknowns) - part.rates.leftCols(unknowns))
                  .partialPivLu()
                  .solve(part.rates.rightCols(others));
    r.end = part.end.rightCols(others) + part.end.leftCols(unknowns) * r.rates;
    r.wrench = part.wrench.rightCols(others) + part.wrench.leftCols(unknowns) * r.rates;
    const auto start = [](const Motion& motion) { return motion.template leftCols<kDof>(); };
    const auto beyond = [](const Motion& motion) { return motion.template middleCols<kDof>(kDof); };
    // end = start + beyond (P end + Q) + own
    const Eigen::PartialPivLU<Matrix> lu(Matrix::Identity() - beyond(r.end) * P);
    r.end_by_start = lu.solve(Matrix(start(r.end)));
    Motion own = beyond(r.end) * Q;
    own.middleCols(part.first_column, part.columns) += r.end.rightCols(part.columns);
    r.end_own = lu.solve(own);
    r.beyond_by_end = P;
    r.beyond_own = Q;
    const Matrix by_beyond = beyond(r.wrench);
    Q = by_beyond * (P * r.end_own + r.beyond_own);
    Q.middleCols(part.first_column, part.columns) += r.wrench.rightCols(part.columns);
    P = Matrix(start(r.wrench)) + by_beyond * P * r.end_by_start;
  }
  Response out;
  out.starts.push_back(Motion::Zero(kDof, at_tip.cols()));
  for (int e = 0; e < count; ++e) {
    const Part& part = parts_[e];
    const Reduced& r = reduced[e];
    const Motion end = r.end_by_start * out.starts[e] + r.end_own;
    Eigen::MatrixXd rates =
        r.rates.template leftCols<kDof>() * out.starts[e] +
        r.rates.template middleCols<kDof>(kDof) * (r.beyond_by_end * end + r.beyond_own);
    rates.middleCols(part.first_column, part.columns) += r.rates.rightCols(part.columns);
    out.rates.push_back(std::move(rates));
    out.starts.push_back(end);
  }
  return out;
}

template <class Group>
typename LinearChain<Group>::Response LinearChain<Group>::answer(
    const std::vector<Eigen::MatrixXd>& rates, const Motion& at_tip) const {
  constexpr int kDof = Group::kDof;
  const int count = static_cast<int>(parts_.size());
  Response out;
  out.starts.push_back(Motion::Zero(kDof, at_tip.cols()));
  const auto multiply = [&](const Part& part, const auto& by, int e, const Motion& beyond) {
    Eigen::MatrixXd sum = by.leftCols(part.unknowns) * rates[e] +
                          by.template middleCols<kDof>(part.unknowns) * out.starts[e] +
                          by.template middleCols<kDof>(part.unknowns + kDof) * beyond;
    sum.middleCols(part.first_column, part.columns) += by.rightCols(part.columns);
    return sum;
  };
  for (int e = 0; e < count; ++e) {
    // The motion does not depend on the wrench.
    out.starts.push_back(multiply(parts_[e], parts_[e].end, e, Motion::Zero(kDof, at_tip.cols())));
  }
  out.rates.resize(parts_.size());
  Motion beyond = at_tip;
  for (int e = count - 1; e >= 0; --e) {
    out.rates[e] = multiply(parts_[e], parts_[e].rates, e, beyond);
    beyond = multiply(parts_[e], parts_[e].wrench, e, beyond);
  }
  return out;
}

template class LinearChain<lie::SE2>;
template class LinearChain<lie::SE3>;

}  // namespace helix_arm::statics
