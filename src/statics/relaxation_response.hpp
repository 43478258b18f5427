#pragma once

#include <utility>
#include <vector>

#include "helix_arm/lie/jacobian_slope.hpp"
#include "helix_arm/model/taper.hpp"
#include "relaxation.hpp"

/// Derivatives of solutions of the loaded tier.
namespace helix_arm::statics {

/// A parameter that changes no section: the column of a residual.
template <class Group>
class NoChange final : public UnloadedChange<Group> {
 public:
  using typename UnloadedChange<Group>::Motion;
  using typename UnloadedChange<Group>::Tangent;
  int count() const override { return 1; }
  int first(int /*k*/) const override { return 0; }
  int columns(int /*k*/) const override { return 1; }
  Motion twist(int /*k*/, double /*s*/) const override { return Motion::Zero(Group::kDof, 1); }
  Motion strain(int /*k*/, double /*s*/, const Tangent& /*strain*/) const override {
    return Motion::Zero(Group::kDof, 1);
  }
};

template <class Group>
template <int kNodes>
LinearElement<Group> LoadedArmOf<Group>::Relaxation<kNodes>::linearised(
    int e, const UnloadedChange<Group>& change) const {
  using Matrix = typename Group::Matrix;
  using Motion = typename LinearChain<Group>::Motion;
  const Element& element = arm_.elements_[e];
  const Group& start = start_[e];
  const std::vector<Motion> unloaded = unloaded_.changes(e, change);
  LinearElement<Group> out;
  out.before = rule_.before();
  out.after = rule_.after();
  out.weights = rule_.weights();
  out.first_column = change.first(element.section);
  for (int j = 0; j < kNodes; ++j) {
    const int node = e * kNodes + j;
    const Tangent& z = z_[node];
    const Matrix Ad_unloaded = unloaded_.atNode(node).adjoint();
    const Matrix& C = unloaded_.compliance(e, j);
    const Matrix Jr_inverse = Group::rightJacobianInverse(z);
    const Tangent strain = C * wrench_[node];
    const Tangent moved_strain = element.length * (Ad_unloaded * strain);
    LinearNode<Group> linear;
    linear.X = {at_rotation_[node], at_[node]};
    linear.wrench = wrench_[node];
    linear.motion_by_z = start.adjoint() * Group::leftJacobian(z);
    linear.motion = (start * Group::exp(z)).adjoint() * unloaded[j];
    linear.rate_by_wrench = element.length * (Jr_inverse * Ad_unloaded * C);
    linear.rate_by_z = lie::solvedRightJacobianSlope(z, moved_strain);
    const double s = element.begin + rule_.nodes()[j] * element.length;
    Motion rate = element.length * (Ad_unloaded * change.strain(element.section, s, strain));
    for (int i = 0; i < rate.cols(); ++i) {
      rate.col(i) += model::bracket(Tangent(unloaded[j].col(i)), moved_strain);
    }
    linear.rate = Jr_inverse * rate;
    out.nodes.push_back(std::move(linear));
  }
  const Tangent z = rates_.template middleCols<kNodes>(e * kNodes) * rule_.weights();
  const Group before_unloaded = start * Group::exp(z);
  out.end_by_z = start.adjoint() * Group::leftJacobian(z);
  out.end = before_unloaded.adjoint() * unloaded[kNodes];
  out.weight = within<Group>(element.length * load_.mass[element.section] * load_.gravity);
  const Group end = before_unloaded * unloaded_.end(e);
  for (const int p : element.points) {
    const PointLoad& point = load_.points[p];
    out.pulls.push_back({end * within<Group>(point.offset), within<Group>(load_.forceOf(point))});
  }
  return out;
}

template <class Group>
template <int kNodes>
std::vector<LinearElement<Group>> LoadedArmOf<Group>::Relaxation<kNodes>::linearised(
    const UnloadedChange<Group>& change) const {
  std::vector<LinearElement<Group>> out;
  for (int e = 0; e < count_; ++e) out.push_back(linearised(e, change));
  return out;
}

template <class Group>
template <int kNodes>
typename LinearChain<Group>::Motion LoadedArmOf<Group>::Relaxation<kNodes>::wrenchAtTip(
    int parameters, bool by_load) const {
  return wrenchesAt<Group>(tip_.translation, parameters, by_load);
}

template <class Group>
template <int kNodes>
void LoadedArmOf<Group>::Relaxation<kNodes>::polish() {
  if (kNodes == kLeastOrder + 1) return;  // its result is no fixed point
  Rates answer;
  evaluate(answer);
  const NoChange<Group> none;
  std::vector<LinearElement<Group>> elements = linearised(none);
  for (int node = 0; node < rates_.cols(); ++node) {
    elements[node / kNodes].nodes[node % kNodes].rate = answer.col(node) - rates_.col(node);
  }
  const auto step = LinearChain<Group>(elements).balanced(wrenchAtTip(1, false));
  for (int e = 0; e < count_; ++e) {
    rates_.template middleCols<kNodes>(e * kNodes) += step.rates[e].reshaped(kDof, kNodes);
  }
  place();
}

template <class Group>
template <int kNodes>
typename LinearChain<Group>::Response LoadedArmOf<Group>::Relaxation<kNodes>::respond(
    const UnloadedChange<Group>& change, bool by_load) {
  if (kNodes == kLeastOrder + 1) return respondToOneStep(change, by_load);
  Rates answer;
  evaluate(answer);
  return LinearChain<Group>(linearised(change)).balanced(wrenchAtTip(change.count(), by_load));
}

// The derivative of takeOneStep().
template <class Group>
template <int kNodes>
typename LinearChain<Group>::Response LoadedArmOf<Group>::Relaxation<kNodes>::respondToOneStep(
    const UnloadedChange<Group>& change, bool by_load) {
  using Matrices = std::vector<Eigen::MatrixXd>;
  const Eigen::Index columns = wrenchAtTip(change.count(), by_load).cols();
  const auto answerTo = [&](const Matrices& rates) {
    return LinearChain<Group>(linearised(change))
        .answer(rates, wrenchAtTip(change.count(), by_load));
  };
  const Rates found = rates_;
  Rates first, second;
  rates_.setZero();
  evaluate(first);
  const Matrices by_first =
      answerTo(Matrices(static_cast<std::size_t>(count_), Eigen::MatrixXd::Zero(kRates, columns)))
          .rates;
  rates_ = first;
  evaluate(second);
  const Matrices by_second = answerTo(by_first).rates;
  // factor = first . (second - first) / |first|^2
  const Rates step = second - first;
  Rates weight = scale_.cwiseAbs2().replicate(1, rates_.cols());
  const double square = flat(weight).dot(first.reshaped().cwiseAbs2());
  const double factor =
      square > 0 ? flat(weight).cwiseProduct(first.reshaped()).dot(step.reshaped()) / square : 0.0;
  Eigen::RowVectorXd by_factor = Eigen::RowVectorXd::Zero(columns);
  for (int e = 0; e < count_ && square > 0; ++e) {
    const auto at = [&](const Rates& rates) {
      return rates.template middleCols<kNodes>(e * kNodes).reshaped();
    };
    const Eigen::VectorXd w = at(weight);
    by_factor += (w.cwiseProduct(at(step)) - 2.0 * factor * w.cwiseProduct(at(first))).transpose() *
                     by_first[e] / square +
                 w.cwiseProduct(at(first)).transpose() * (by_second[e] - by_first[e]) / square;
  }
  Matrices by_found;
  for (int e = 0; e < count_; ++e) {
    const Eigen::VectorXd of_step = step.template middleCols<kNodes>(e * kNodes).reshaped();
    by_found.push_back(by_second[e] + factor / (1.0 - factor) * (by_second[e] - by_first[e]) +
                       of_step * by_factor / ((1.0 - factor) * (1.0 - factor)));
  }
  rates_ = found;
  evaluate(second);
  typename LinearChain<Group>::Response out = answerTo(by_found);
  out.rates = by_found;
  return out;
}

template <class Group>
template <int kNodes>
std::vector<Eigen::Matrix<double, 6, Eigen::Dynamic>>
LoadedArmOf<Group>::Relaxation<kNodes>::pieceMotions(
    int sections, const UnloadedChange<Group>& change,
    const typename LinearChain<Group>::Response& response) const {
  using Motion = typename LinearChain<Group>::Motion;
  std::vector<Eigen::Matrix<double, 6, Eigen::Dynamic>> out;
  std::vector<Motion> unloaded;
  Place place{*this};
  int of = -1;  // the element of `unloaded`
  for (int piece = 0; piece < sections * kLoadedPieces; ++piece) {
    const double t = place.go(piece / kLoadedPieces,
                              static_cast<double>(piece % kLoadedPieces + 1) / kLoadedPieces);
    const int e = place.e, section = arm_.elements_[e].section;
    if (of != e) unloaded = unloaded_.changes(e, change);
    of = e;
    const Eigen::Matrix<double, kNodes, 1> weights = rule_.upTo(t);
    const Tangent z = rates_.template middleCols<kNodes>(e * kNodes) * weights;
    Motion by_z = Motion::Zero(kDof, response.starts[e].cols());
    for (int l = 0; l < kNodes; ++l) {
      by_z += weights[l] * response.rates[e].template middleRows<kDof>(kDof * l);
    }
    Motion motion = response.starts[e] + start_[e].adjoint() * Group::leftJacobian(z) * by_z;
    motion.middleCols(change.first(section), change.columns(section)) +=
        (start_[e] * Group::exp(z)).adjoint() * unloaded_.changeAt(e, t, change, unloaded);
    out.push_back(motionsInSpace(motion));
  }
  return out;
}

}  // namespace helix_arm::statics
