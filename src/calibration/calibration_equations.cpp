#include "calibration_equations.hpp"

#include <algorithm>
#include <limits>
#include <map>
#include <set>
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

CalibrationEquations::CalibrationEquations(const ParameterBlocks& blocks,
                                           const std::vector<ReadingTerm>& terms,
                                           ParameterBlock eliminated)
    : blocks_(blocks) {
  std::map<int, std::set<int>> partners;  // columns of the rest that readings of a block have, too
  for (const ReadingTerm& term : terms) {
    const auto kindOf = [&](int b) { return blocks.all()[b].kind; };
    const auto own = std::find_if(term.blocks.begin(), term.blocks.end(),
                                  [&](int b) { return kindOf(b) == eliminated; });
    for (const int b : term.blocks) {
      if (own == term.blocks.end() || b == *own) continue;
      const ParameterBlocks::Block& other = blocks.all()[b];
      for (int i = 0; i < other.size(); ++i) {
        partners[blocks.all()[*own].column].insert(other.column + i);
      }
    }
  }
  for (const ParameterBlocks::Block& block : blocks.all()) {
    if (block.kind == eliminated) {
      eliminated_.push_back({block.column, block.size(), {}, {}, {}, {}});
      continue;
    }
    for (int i = 0; i < block.size(); ++i) rest_.push_back(block.column + i);
  }
  for (Eliminated& one : eliminated_) {
    for (const int column : partners[one.column]) {
      const auto place = std::lower_bound(rest_.begin(), rest_.end(), column);
      one.at.push_back(static_cast<int>(place - rest_.begin()));
    }
  }
  H_.resize(blocks.columns(), blocks.columns());
  gradient_.resize(blocks.columns());
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
  reduced_ = H_(rest_, rest_);
  reduced_.diagonal() += damping(rest_);
  reduced_gradient_ = gradient_(rest_);
  for (Eliminated& one : eliminated_) {
    const auto columns = H_.middleCols(one.column, one.size);
    Eigen::MatrixXd own = columns.middleRows(one.column, one.size);
    own.diagonal() += damping.segment(one.column, one.size);
    if (one.root.compute(own).info() != Eigen::Success) return false;
    one.cross.resize(one.size, static_cast<Eigen::Index>(one.at.size()));
    Eigen::Index column = 0;
    for (const int i : one.at) one.cross.col(column++) = columns.row(rest_[i]);
    one.root.matrixL().solveInPlace(one.cross);
    one.gradient = one.root.matrixL().solve(gradient_.segment(one.column, one.size));
    const Eigen::MatrixXd square = one.cross.transpose() * one.cross;
    reduced_(one.at, one.at) -= square;
    reduced_gradient_(one.at) -= one.cross.transpose() * one.gradient;
  }
  // Eigen calls NaN a success.
  return root_.compute(reduced_).info() == Eigen::Success &&
         root_.matrixLLT().diagonal().allFinite();
}

Eigen::VectorXd CalibrationEquations::step() const {
  Eigen::VectorXd out(gradient_.size());
  const Eigen::VectorXd rest = root_.solve(-reduced_gradient_);
  out(rest_) = rest;
  for (const Eliminated& one : eliminated_) {
    const Eigen::VectorXd scaled = -one.gradient - one.cross * rest(one.at);
    out.segment(one.column, one.size) = one.root.matrixU().solve(scaled);
  }
  return out;
}

Eigen::MatrixXd CalibrationEquations::reducedInverse() const {
  return root_.solve(Eigen::MatrixXd::Identity(reduced_.rows(), reduced_.cols()));
}

double CalibrationEquations::inverseTrace(const Eigen::VectorXd& weights) const {
  const Eigen::MatrixXd reduced = reducedInverse();
  double trace = reduced.diagonal().dot(weights(rest_));
  for (const Eliminated& one : eliminated_) {
    const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(one.size, one.size);
    const Eigen::MatrixXd inverse = one.root.matrixU().solve(unit);
    const Eigen::MatrixXd own_reduced = reduced(one.at, one.at);
    const Eigen::MatrixXd variance = unit + one.cross * own_reduced * one.cross.transpose();
    trace += (inverse * variance * inverse.transpose())
                 .diagonal()
                 .dot(weights.segment(one.column, one.size));
  }
  return trace;
}

}  // namespace helix_arm::estimation
