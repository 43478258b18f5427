#include "calibration_equations.hpp"

#include <limits>

namespace helix_arm::estimation {

void LinearisedReadings::update(const Included& included, bool derivatives) {
  const Eigen::VectorXd& numbers = blocks_.numbers();
  if (at_.size() != numbers.size() || at_ != numbers) {
    for (LinearisedCapture& one : captures_) one.known = LinearisedCapture::kNothing;
    at_ = numbers;
  }
  const auto wanted = derivatives ? LinearisedCapture::kDerivatives : LinearisedCapture::kResiduals;
  for (std::size_t c = 0; c < captures_.size(); ++c) {
    if (captures_[c].known >= wanted || !included(static_cast<int>(c))) continue;
    evaluate(c, derivatives);
    captures_[c].known = wanted;
  }
}

void LinearisedReadings::evaluate(std::size_t capture, bool derivatives) {
  LinearisedCapture& out = captures_[capture];
  out.state = stateAt(shared_, places_[capture], kind_, blocks_, derivatives);
  out.terms.resize(costs_[capture].size());
  for (std::size_t t = 0; t < out.terms.size(); ++t) {
    LinearisedCapture::Term& term = out.terms[t];
    const bool found = out.state.shape.found &&
                       costs_[capture][t]->evaluate(out.state, blocks_, term.residual,
                                                    derivatives ? &term.J : nullptr, by_pieces_);
    term.square = found ? term.residual.squaredNorm() : std::numeric_limits<double>::infinity();
  }
}

CalibrationEquations::CalibrationEquations(const ParameterBlocks& blocks, ParameterBlock eliminated)
    : blocks_(blocks.all()),
      H_(Eigen::MatrixXd::Zero(blocks.columns(), blocks.columns())),
      gradient_(Eigen::VectorXd::Zero(blocks.columns())) {
  for (const ParameterBlocks::Block& block : blocks_) {
    if (block.kind == eliminated) {
      eliminated_.push_back({block.column, block.size()});
      continue;
    }
    for (int i = 0; i < block.size(); ++i) rest_.push_back(block.column + i);
  }
}

void CalibrationEquations::clear() {
  H_.setZero();
  gradient_.setZero();
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

void CalibrationEquations::addTerm(const ReadingCost& cost, const Eigen::MatrixXd& J,
                                   const Eigen::VectorXd& residual, double weight) {
  const Eigen::MatrixXd square = weight * J.transpose() * J;
  const Eigen::VectorXd by_residual = weight * J.transpose() * residual;
  int i = 0;
  for (const int a : cost.blocks()) {
    const ParameterBlocks::Block& row = blocks_[static_cast<std::size_t>(a)];
    gradient_.segment(row.column, row.size()) += by_residual.segment(i, row.size());
    int j = 0;
    for (const int b : cost.blocks()) {
      const ParameterBlocks::Block& column = blocks_[static_cast<std::size_t>(b)];
      H_.block(row.column, column.column, row.size(), column.size()) +=
          square.block(i, j, row.size(), column.size());
      j += column.size();
    }
    i += row.size();
  }
}

bool CalibrationEquations::factor(const Eigen::VectorXd& damping) {
  // Eigen calls NaN a success.
  const auto sound = [](const Cholesky& root) {
    return root.info() == Eigen::Success && root.matrixLLT().diagonal().allFinite();
  };
  reduced_ = H_(rest_, rest_);
  reduced_.diagonal() += damping(rest_);
  reduced_gradient_ = gradient_(rest_);
  for (Eliminated& one : eliminated_) {
    std::vector<int> columns;
    one.at.clear();
    for (std::size_t k = 0; k < rest_.size(); ++k) {
      if (H_.col(rest_[k]).segment(one.column, one.size).isZero(0)) continue;
      one.at.push_back(static_cast<int>(k));
      columns.push_back(rest_[k]);
    }
    const auto rows = H_.middleRows(one.column, one.size);
    Eigen::MatrixXd own = rows.middleCols(one.column, one.size);
    own.diagonal() += damping.segment(one.column, one.size);
    if (!sound(one.root.compute(own))) return false;
    one.scaled_cross = one.root.matrixL().solve(rows(Eigen::all, columns));
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
