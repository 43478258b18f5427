#include "linear_chain.hpp"

#include <Eigen/LU>

#include "shape_motion.hpp"

namespace helix_arm::statics {
namespace {

// Product of matrices whose sizes are known at run time only, compiled once for all types.
Eigen::MatrixXd product(const Eigen::Ref<const Eigen::MatrixXd>& a,
                        const Eigen::Ref<const Eigen::MatrixXd>& b) {
  return a * b;
}

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

// Motion by that of the element's start, the wrench beyond and the parameters.
template <class Group>
typename LinearNode<Group>::Motion othersOf(const typename LinearNode<Group>::Motion& by_own) {
  constexpr int kDof = Group::kDof;
  typename LinearNode<Group>::Motion out =
      LinearNode<Group>::Motion::Zero(kDof, 2 * kDof + by_own.cols());
  out.template leftCols<kDof>().setIdentity();
  out.rightCols(by_own.cols()) = by_own;
  return out;
}

// Moments of an element's loads about the base's origin, by its rates and by the others (the motion
// of its start, the wrench beyond it and its parameters).
template <class Group>
struct LoadMoments {
  static constexpr int kRotations = Group::kRotations;
  using Moments = Eigen::Matrix<double, kRotations, Group::kDof>;
  using OtherMoments = Eigen::Matrix<double, kRotations, Eigen::Dynamic>;

  explicit LoadMoments(const LinearElement<Group>& given) : element(given) {
    const auto end = othersOf<Group>(element.end);
    pulled_others.setZero(kRotations, end.cols());
    for (const auto& pull : element.pulls) {
      const Moments by_motion = momentsOf(pull.force) * displacementOf(pull.at);
      pulled += by_motion * element.end_by_z;
      pulled_others += by_motion * end;
    }
    for (const LinearNode<Group>& node : element.nodes) {
      const Moments by_motion = momentsOf(element.weight) * displacementOf(node.X.translation);
      motions.push_back(othersOf<Group>(node.motion));
      weighed.push_back(by_motion * node.motion_by_z);
      weighed_others.push_back(by_motion * motions.back());
    }
  }

  // Moments of the loads beyond a place, whose weights are those of the integral from there on.
  template <class Weights>
  Moments byRate(const Weights& weights, int l) const {
    Moments sum = element.weights[l] * pulled;
    for (std::size_t k = 0; k < weighed.size(); ++k) {
      sum += weights[k] * element.before(l, k) * weighed[k];
    }
    return sum;
  }
  template <class Weights>
  OtherMoments byOthers(const Weights& weights) const {
    OtherMoments sum = pulled_others;
    for (std::size_t k = 0; k < weighed.size(); ++k) sum += weights[k] * weighed_others[k];
    return sum;
  }

  const LinearElement<Group>& element;
  std::vector<typename LinearNode<Group>::Motion> motions;  // of the nodes by the others
  Moments pulled = Moments::Zero();                         // of the pulls, by z at the end
  OtherMoments pulled_others;
  std::vector<Moments> weighed;  // of the weight at each node, by z there
  std::vector<OtherMoments> weighed_others;
};

}  // namespace

template <class Group>
LinearChain<Group>::LinearChain(const std::vector<LinearElement<Group>>& elements) {
  parts_.reserve(elements.size());
  for (const LinearElement<Group>& element : elements) parts_.push_back(partOf(element));
}

template <class Group>
typename LinearChain<Group>::Part LinearChain<Group>::partOf(const LinearElement<Group>& element) {
  constexpr int kDof = Group::kDof, kRotations = Group::kRotations;
  using Matrix = typename Group::Matrix;
  const int nodes = static_cast<int>(element.nodes.size());
  const int own = static_cast<int>(element.end.cols());
  const int unknowns = kDof * nodes, others = 2 * kDof + own, all = unknowns + others;
  Part out{unknowns,          element.first_column,   own, Eigen::MatrixXd(unknowns, all),
           Motion(kDof, all), Motion::Zero(kDof, all)};
  for (int l = 0; l < nodes; ++l) {
    out.end.template middleCols<kDof>(kDof * l) = element.weights[l] * element.end_by_z;
  }
  out.end.rightCols(others) = othersOf<Group>(element.end);
  const LoadMoments<Group> loads(element);
  for (int j = 0; j < nodes; ++j) {
    const LinearNode<Group>& node = element.nodes[j];
    const Matrix by_wrench = node.rate_by_wrench * node.X.adjoint().transpose();
    // A motion turns the point against the wrench.
    const Matrix by_motion = node.rate_by_wrench * turned(node.wrench) * node.X.inverse().adjoint();
    const Matrix by_z = by_motion * node.motion_by_z + node.rate_by_z;
    const Eigen::Matrix<double, kDof, kRotations> by_moment =
        by_wrench.template rightCols<kRotations>();
    const Eigen::VectorXd beyond = element.after.col(j);
    auto rate = out.rates.template middleRows<kDof>(kDof * j);
    for (int l = 0; l < nodes; ++l) {
      rate.template middleCols<kDof>(kDof * l) =
          element.before(l, j) * by_z + by_moment * loads.byRate(beyond, l);
    }
    auto other = rate.rightCols(others);
    other.noalias() = by_motion * loads.motions[j];
    other.noalias() += by_moment * loads.byOthers(beyond);
    other.template middleCols<kDof>(kDof) += by_wrench;
    other.rightCols(own) += node.rate;
  }
  out.wrench.template middleCols<kDof>(unknowns + kDof).setIdentity();
  auto at_start = out.wrench.template bottomRows<kRotations>();
  for (int l = 0; l < nodes; ++l) {
    at_start.template middleCols<kDof>(kDof * l) = loads.byRate(element.weights, l);
  }
  at_start.rightCols(others) += loads.byOthers(element.weights);
  return out;
}

template <class Group>
typename LinearChain<Group>::Response LinearChain<Group>::balanced(const Motion& at_tip) const {
  constexpr int kDof = Group::kDof;
  using Matrix = typename Group::Matrix;
  // Equations of each element, with its own rates eliminated.
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
    r.end = part.end.rightCols(others) + product(part.end.leftCols(unknowns), r.rates);
    r.wrench = part.wrench.rightCols(others) + product(part.wrench.leftCols(unknowns), r.rates);
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
        product(r.rates.template leftCols<kDof>(), out.starts[e]) +
        product(r.rates.template middleCols<kDof>(kDof), r.beyond_by_end * end + r.beyond_own);
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
    Eigen::MatrixXd sum = product(by.leftCols(part.unknowns), rates[e]) +
                          product(by.template middleCols<kDof>(part.unknowns), out.starts[e]) +
                          product(by.template middleCols<kDof>(part.unknowns + kDof), beyond);
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
