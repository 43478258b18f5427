#include "calibration_equations.hpp"

#include <algorithm>
#include <limits>
#include <utility>

namespace helix_arm::estimation {

LinearisedReadings::LinearisedReadings(Shared& shared, ReadingKind kind,
                                       const std::vector<Place>& places,
                                       const std::vector<ReadingTerm>& terms)
    : shared_(shared),
      kind_(kind),
      places_(places),
      terms_(terms),
      first_term_(places.size() + 1, terms.size()),
      known_(places.size(), kNothing),
      states_(places.size()),
      squares_(terms.size(), 0.0),
      residuals_(terms.size()),
      jacobians_(terms.size()) {
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const auto capture = static_cast<std::size_t>(terms[t].cost->place().capture);
    first_term_[capture] = std::min(first_term_[capture], t);
  }
  for (std::size_t c = places.size(); c-- > 0;) {
    first_term_[c] = std::min(first_term_[c], first_term_[c + 1]);
  }
}

void LinearisedReadings::update(const Values& values, const Eigen::VectorXd& numbers,
                                const Included& included, bool derivatives) {
  if (at_.size() != numbers.size() || at_ != numbers) {
    std::fill(known_.begin(), known_.end(), kNothing);
    at_ = numbers;
  }
  const Known wanted = derivatives ? kDerivatives : kResiduals;
  for (int c = 0; c < static_cast<int>(places_.size()); ++c) {
    if (known_[c] < wanted && included(c)) evaluate(c, values, derivatives);
  }
}

void LinearisedReadings::evaluate(int capture, const Values& values, bool derivatives) {
  CaptureState& state = states_[capture];
  state = stateAt(shared_, places_[capture], kind_, values, derivatives);
  for (std::size_t t = first_term_[capture]; t < first_term_[capture + 1]; ++t) {
    const ReadingCost& cost = *terms_[t].cost;
    squares_[t] = std::numeric_limits<double>::infinity();
    if (!state.shape.found || !cost.evaluate(state, values, residuals_[t],
                                             derivatives ? &jacobians_[t] : nullptr, by_pieces_)) {
      continue;
    }
    squares_[t] = residuals_[t].squaredNorm();
  }
  known_[capture] = derivatives ? kDerivatives : kResiduals;
}

CalibrationEquations::CalibrationEquations(const ParameterBlocks& blocks, ParameterBlock eliminated)
    : blocks_(blocks) {
  for (const ParameterBlocks::Block& block : blocks.all()) {
    const bool first = block.kind == eliminated;
    if (first) eliminated_.push_back(block);
    for (int i = 0; i < block.size(); ++i) (first ? first_ : rest_).push_back(block.column + i);
  }
  H_.resize(blocks.columns(), blocks.columns());
  gradient_.resize(blocks.columns());
  roots_.resize(eliminated_.size());
}

void CalibrationEquations::addPrior(const ParameterBlocks::Block& block,
                                    const Eigen::VectorXd& offset) {
  const Eigen::VectorXd precision = block.deviation.array().square().inverse();
  H_.diagonal().segment(block.column, block.size()) += precision;
  gradient_.segment(block.column, block.size()) += precision.cwiseProduct(offset);
}

void CalibrationEquations::addDirection(const ParameterBlocks::Block& block,
                                        const Eigen::VectorXd& direction, double deviation,
                                        double offset) {
  const double precision = 1 / (deviation * deviation);
  H_.block(block.column, block.column, block.size(), block.size()) +=
      precision * direction * direction.transpose();
  gradient_.segment(block.column, block.size()) += precision * offset * direction;
}

void CalibrationEquations::addTerm(const ReadingTerm& term, const Eigen::MatrixXd& J,
                                   const Eigen::VectorXd& residual, double weight) {
  addInformation(term, blocks_, J, weight, H_);
  int column = 0;
  for (const int b : term.blocks) {
    const ParameterBlocks::Block& block = blocks_.all()[b];
    gradient_.segment(block.column, block.size()).noalias() +=
        weight * J.middleCols(column, block.size()).transpose().lazyProduct(residual);
    column += block.size();
  }
}

bool CalibrationEquations::factor(const Eigen::VectorXd& damping) {
  cross_ = H_(first_, rest_);
  scaled_gradient_ = gradient_(first_);
  Eigen::Index row = 0;
  for (std::size_t b = 0; b < eliminated_.size(); ++b) {
    const int column = eliminated_[b].column, size = eliminated_[b].size();
    Eigen::MatrixXd own = H_.block(column, column, size, size);
    own.diagonal() += damping.segment(column, size);
    if (roots_[b].compute(own).info() != Eigen::Success) return false;
    auto cross = cross_.middleRows(row, size);
    auto gradient = scaled_gradient_.segment(row, size);
    roots_[b].matrixL().solveInPlace(cross);
    roots_[b].matrixL().solveInPlace(gradient);
    row += size;
  }
  reduced_ = H_(rest_, rest_);
  reduced_.diagonal() += damping(rest_);
  reduced_.selfadjointView<Eigen::Lower>().rankUpdate(cross_.transpose(), -1);
  // Eigen calls NaN a success.
  return root_.compute(reduced_).info() == Eigen::Success &&
         root_.matrixLLT().diagonal().allFinite();
}

Eigen::VectorXd CalibrationEquations::step() const {
  Eigen::VectorXd out(gradient_.size());
  const Eigen::VectorXd rest =
      root_.solve(cross_.transpose() * scaled_gradient_ - gradient_(rest_));
  out(rest_) = rest;
  const Eigen::VectorXd scaled = -scaled_gradient_ - cross_ * rest;
  Eigen::Index row = 0;
  for (std::size_t b = 0; b < eliminated_.size(); ++b) {
    const int size = eliminated_[b].size();
    out.segment(eliminated_[b].column, size) = roots_[b].matrixU().solve(scaled.segment(row, size));
    row += size;
  }
  return out;
}

Eigen::MatrixXd CalibrationEquations::reducedInverse() const {
  return root_.solve(Eigen::MatrixXd::Identity(reduced_.rows(), reduced_.cols()));
}

double CalibrationEquations::inverseTrace(const Eigen::VectorXd& weights) const {
  const Eigen::MatrixXd reduced = reducedInverse();
  double trace = reduced.diagonal().dot(weights(rest_));
  const Eigen::MatrixXd spread = cross_ * reduced;
  Eigen::Index row = 0;
  for (std::size_t b = 0; b < eliminated_.size(); ++b) {
    const int size = eliminated_[b].size();
    const auto cross = cross_.middleRows(row, size);
    const Eigen::MatrixXd inverse =
        roots_[b].matrixU().solve(Eigen::MatrixXd::Identity(size, size));
    const Eigen::MatrixXd variance =
        Eigen::MatrixXd::Identity(size, size) + spread.middleRows(row, size) * cross.transpose();
    trace += (inverse * variance * inverse.transpose())
                 .diagonal()
                 .dot(weights.segment(eliminated_[b].column, size));
    row += size;
  }
  return trace;
}

}  // namespace helix_arm::estimation
