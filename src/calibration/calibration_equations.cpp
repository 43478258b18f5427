#include "calibration_equations.hpp"

#include <algorithm>
#include <limits>
#include <set>

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
    : blocks_(blocks), gradient_(Eigen::VectorXd::Zero(blocks.columns())) {
  for (const ParameterBlocks::Block& block : blocks.all()) {
    if (block.kind == eliminated) {
      places_.push_back(-1 - static_cast<int>(eliminated_.size()));
      eliminated_.push_back({block.column, block.size(), {}, {}, {}, {}, {}, {}});
      continue;
    }
    places_.push_back(static_cast<int>(rest_.size()));
    for (int i = 0; i < block.size(); ++i) rest_.push_back(block.column + i);
  }
  H_rest_.setZero(rest_.size(), rest_.size());
  std::vector<std::set<int>> partners(eliminated_.size());
  for (const ReadingTerm& term : terms) {
    const auto own = std::find_if(term.blocks.begin(), term.blocks.end(),
                                  [this](int b) { return places_[b] < 0; });
    if (own == term.blocks.end()) continue;
    for (const int b : term.blocks) {
      for (int i = 0; places_[b] >= 0 && i < blocks.all()[b].size(); ++i) {
        partners[-1 - places_[*own]].insert(places_[b] + i);
      }
    }
  }
  for (std::size_t k = 0; k < eliminated_.size(); ++k) {
    Eliminated& one = eliminated_[k];
    one.at.assign(partners[k].begin(), partners[k].end());
    one.own.setZero(one.size, one.size);
    one.cross.setZero(one.size, static_cast<Eigen::Index>(one.at.size()));
  }
}

void CalibrationEquations::clear() {
  H_rest_.setZero();
  gradient_.setZero();
  for (Eliminated& one : eliminated_) {
    one.own.setZero();
    one.cross.setZero();
  }
}

void CalibrationEquations::addPrior(std::size_t b, const Eigen::VectorXd& offset) {
  const ParameterBlocks::Block& block = blocks_.all()[b];
  const Eigen::VectorXd precision = block.deviation.array().square().inverse();
  if (places_[b] < 0) {
    eliminated_[-1 - places_[b]].own.diagonal() += precision;
  } else {
    H_rest_.diagonal().segment(places_[b], block.size()) += precision;
  }
  gradient_.segment(block.column, block.size()) += precision.cwiseProduct(offset);
}

void CalibrationEquations::addDirection(std::size_t b, const Eigen::VectorXd& direction,
                                        double deviation, double offset) {
  const ParameterBlocks::Block& block = blocks_.all()[b];
  const double precision = 1 / (deviation * deviation);
  H_rest_.block(places_[b], places_[b], block.size(), block.size()) +=
      precision * direction * direction.transpose();
  gradient_.segment(block.column, block.size()) += precision * offset * direction;
}

void CalibrationEquations::addTerm(const ReadingTerm& term, const Eigen::MatrixXd& J,
                                   const Eigen::VectorXd& residual, double weight) {
  const Eigen::MatrixXd square = weight * J.transpose() * J;
  const Eigen::VectorXd by_residual = weight * J.transpose() * residual;
  int i = 0;
  for (const int a : term.blocks) {
    const ParameterBlocks::Block& row = blocks_.all()[a];
    gradient_.segment(row.column, row.size()) += by_residual.segment(i, row.size());
    int j = 0;
    for (const int b : term.blocks) {
      const int columns = blocks_.all()[b].size();
      const auto part = square.block(i, j, row.size(), columns);
      j += columns;
      if (places_[a] >= 0) {
        if (places_[b] >= 0) H_rest_.block(places_[a], places_[b], row.size(), columns) += part;
        continue;
      }
      Eliminated& one = eliminated_[-1 - places_[a]];
      if (a == b) {
        one.own += part;
      } else {
        const auto first = std::lower_bound(one.at.begin(), one.at.end(), places_[b]);
        one.cross.middleCols(first - one.at.begin(), columns) += part;
      }
    }
    i += row.size();
  }
}

Eigen::VectorXd CalibrationEquations::diagonal() const {
  Eigen::VectorXd out(gradient_.size());
  out(rest_) = H_rest_.diagonal();
  for (const Eliminated& one : eliminated_) out.segment(one.column, one.size) = one.own.diagonal();
  return out;
}

Eigen::MatrixXd CalibrationEquations::hessian() const {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(gradient_.size(), gradient_.size());
  out(rest_, rest_) = H_rest_;
  for (const Eliminated& one : eliminated_) {
    out.block(one.column, one.column, one.size, one.size) = one.own;
    for (std::size_t j = 0; j < one.at.size(); ++j) {
      const auto cross = one.cross.col(static_cast<Eigen::Index>(j));
      out.col(rest_[one.at[j]]).segment(one.column, one.size) = cross;
      out.row(rest_[one.at[j]]).segment(one.column, one.size) = cross.transpose();
    }
  }
  return out;
}

bool CalibrationEquations::factor(const Eigen::VectorXd& damping) {
  // Eigen calls NaN a success.
  const auto sound = [](const Cholesky& root) {
    return root.info() == Eigen::Success && root.matrixLLT().diagonal().allFinite();
  };
  reduced_ = H_rest_;
  reduced_.diagonal() += damping(rest_);
  reduced_gradient_ = gradient_(rest_);
  for (Eliminated& one : eliminated_) {
    Eigen::MatrixXd own = one.own;
    own.diagonal() += damping.segment(one.column, one.size);
    if (!sound(one.root.compute(own))) return false;
    one.scaled_cross = one.root.matrixL().solve(one.cross);
    one.scaled_gradient = one.root.matrixL().solve(gradient_.segment(one.column, one.size));
    const Eigen::MatrixXd square = one.scaled_cross.transpose() * one.scaled_cross;
    reduced_(one.at, one.at) -= square;
    reduced_gradient_(one.at) -= one.scaled_cross.transpose() * one.scaled_gradient;
  }
  return sound(root_.compute(reduced_));
}

Eigen::VectorXd CalibrationEquations::step() const {
  Eigen::VectorXd out(gradient_.size());
  const Eigen::VectorXd rest = root_.solve(-reduced_gradient_);
  out(rest_) = rest;
  for (const Eliminated& one : eliminated_) {
    const Eigen::VectorXd scaled = -one.scaled_gradient - one.scaled_cross * rest(one.at);
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
    const Eigen::MatrixXd variance =
        unit + one.scaled_cross * own_reduced * one.scaled_cross.transpose();
    trace += (inverse * variance * inverse.transpose())
                 .diagonal()
                 .dot(weights.segment(one.column, one.size));
  }
  return trace;
}

}  // namespace helix_arm::estimation
