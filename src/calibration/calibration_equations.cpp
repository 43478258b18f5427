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
      squares_(terms.size(), 0.0) {
  std::size_t entries = 0;
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const ReadingCost& cost = *terms[t].cost;
    const auto capture = static_cast<std::size_t>(cost.place().capture);
    first_term_[capture] = std::min(first_term_[capture], t);
    first_entry_.push_back(entries);
    entries += static_cast<std::size_t>(cost.residuals() * cost.stride());
  }
  for (std::size_t c = places.size(); c-- > 0;) {
    first_term_[c] = std::min(first_term_[c], first_term_[c + 1]);
  }
  jacobians_.resize(entries, 0.0);
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
    residuals_.resize(static_cast<std::size_t>(cost.residuals()));
    double* const jacobian = derivatives ? &jacobians_[first_entry_[t]] : nullptr;
    squares_[t] = std::numeric_limits<double>::infinity();
    if (!state.shape.found ||
        !cost.evaluate(state, values, residuals_.data(), jacobian, by_pieces_)) {
      continue;
    }
    squares_[t] =
        Eigen::Map<const Eigen::VectorXd>(residuals_.data(), cost.residuals()).squaredNorm();
    for (int r = 0; derivatives && r < cost.residuals(); ++r) {
      jacobian[r * cost.stride() + cost.columns()] = residuals_[r];
    }
  }
  known_[capture] = derivatives ? kDerivatives : kResiduals;
}

namespace {

// Blocks of some rows and columns, too small for the overhead of general ones.
void addBlock(const double* from, int stride, int rows, int columns, double* to,
              Eigen::Index to_stride) {
  for (int i = 0; i < rows; ++i, from += stride, to += to_stride) {
    for (int j = 0; j < columns; ++j) to[j] += from[j];
  }
}

void addTransposed(const double* from, int stride, int rows, int columns, double* to,
                   Eigen::Index to_stride) {
  for (int i = 0; i < rows; ++i, from += stride) {
    for (int j = 0; j < columns; ++j) to[j * to_stride + i] += from[j];
  }
}

// U^-1 X.
template <class Matrix>
void divideByRootOnly(const RowMajor& U, Matrix& X) {
  for (Eigen::Index i = U.rows(); i-- > 0;) {
    for (Eigen::Index k = i + 1; k < U.rows(); ++k) X.row(i) -= U(i, k) * X.row(k);
    X.row(i) /= U(i, i);
  }
}

}  // namespace

ArrowEquations::ArrowEquations(const ParameterBlocks& blocks, const std::vector<ReadingTerm>& terms,
                               ParameterBlock eliminated)
    : count_(blocks.columns()), blocks_(blocks) {
  int rows = 0;
  for (std::size_t b = 0; b < blocks.all().size(); ++b) {
    const ParameterBlocks::Block& block = blocks.all()[b];
    const bool first = block.kind == eliminated;
    at_.push_back(first ? -1 : rows);
    eliminated_.push_back(first ? static_cast<int>(shapes_or_tags_.size()) : -1);
    if (first) {
      Eliminated one;
      one.block = b;
      one.column = block.column;
      one.size = block.size();
      shapes_or_tags_.push_back(std::move(one));
      continue;
    }
    rows += block.size();
    for (int i = 0; i < block.size(); ++i) columns_.push_back(block.column + i);
  }
  rest_.resize(rows, rows);
  gradient_.resize(rows);
  int most = 0;
  for (const ReadingTerm& term : terms) {
    terms_.push_back(partsOf(term));
    most = std::max(most, terms_.back().size);
  }
  placeCrossColumns();
  largest_ = static_cast<std::size_t>(most * padded(most + 1));
}

ArrowEquations::TermParts ArrowEquations::partsOf(const ReadingTerm& term) const {
  TermParts out;
  out.residuals = term.cost->residuals();
  for (const int b : term.blocks) {
    const int size = blocks_.all()[b].size();
    if (eliminated_[b] >= 0) out.eliminated = eliminated_[b];
    Part* const last = out.parts.empty() ? nullptr : &out.parts.back();
    if (last != nullptr && last->at >= 0 && at_[b] == last->at + last->size) {
      last->size += size;
    } else {
      out.parts.push_back({out.size, size, at_[b], -1});
    }
    out.size += size;
  }
  return out;
}

void ArrowEquations::placeCrossColumns() {
  for (const TermParts& term : terms_) {
    if (term.eliminated < 0) continue;
    std::vector<int>& at = shapes_or_tags_[term.eliminated].at;
    for (const Part& part : term.parts) {
      for (int i = 0; part.at >= 0 && i < part.size; ++i) at.push_back(part.at + i);
    }
  }
  for (Eliminated& one : shapes_or_tags_) {
    std::sort(one.at.begin(), one.at.end());
    one.at.erase(std::unique(one.at.begin(), one.at.end()), one.at.end());
    one.own.resize(one.size, one.size);
    one.cross.resize(one.size, padded(static_cast<int>(one.at.size())));
    one.gradient.resize(one.size);
  }
  for (TermParts& term : terms_) {
    if (term.eliminated < 0) continue;
    const std::vector<int>& at = shapes_or_tags_[term.eliminated].at;
    for (Part& part : term.parts) {
      part.local = static_cast<int>(std::lower_bound(at.begin(), at.end(), part.at) - at.begin());
    }
  }
}

void ArrowEquations::clear(const std::function<bool(const ParameterBlocks::Block&)>& active) {
  rest_.setZero();
  gradient_.setZero();
  for (Eliminated& one : shapes_or_tags_) {
    one.active = active(blocks_.all()[one.block]);
    one.own.setZero();
    one.cross.setZero();
    one.gradient.setZero();
  }
}

void ArrowEquations::addPrior(std::size_t b, const Eigen::VectorXd& offset) {
  const ParameterBlocks::Block& block = blocks_.all()[b];
  const bool first = eliminated_[b] >= 0;
  Eliminated* const one = first ? &shapes_or_tags_[eliminated_[b]] : nullptr;
  if (first && !one->active) return;
  for (int i = 0; i < block.size(); ++i) {
    const double precision = 1 / (block.deviation[i] * block.deviation[i]);
    const int row = first ? i : at_[b] + i;
    (first ? one->own : rest_)(row, row) += precision;
    (first ? one->gradient : gradient_)[row] += precision * offset[i];
  }
}

void ArrowEquations::addDirection(std::size_t b, const Eigen::VectorXd& direction, double deviation,
                                  double offset) {
  const double precision = 1 / (deviation * deviation);
  const Eigen::Index size = direction.size();
  rest_.block(at_[b], at_[b], size, size) += precision * direction * direction.transpose();
  gradient_.segment(at_[b], size) += precision * offset * direction;
}

void ArrowEquations::addTerm(std::size_t t, const double* J, double weight) {
  const TermParts& term = terms_[t];
  const int stride = padded(term.size + 1);
  square_.resize(std::max(square_.size(), largest_));
  squareRows(J, term.residuals, stride, term.size, weight, square_.data());
  Eliminated* const first = term.eliminated < 0 ? nullptr : &shapes_or_tags_[term.eliminated];
  for (std::size_t i = 0; i < term.parts.size(); ++i) {
    const Part& a = term.parts[i];
    const double* const rows = &square_[static_cast<std::size_t>(a.column * stride)];
    double* const gradient = a.at < 0 ? first->gradient.data() : &gradient_[a.at];
    for (int row = 0; row < a.size; ++row) gradient[row] += rows[row * stride + term.size];
    for (std::size_t j = i; j < term.parts.size(); ++j) {
      const Part& b = term.parts[j];
      const double* const block = rows + b.column;
      if (a.at < 0 && b.at < 0) {
        addBlock(block, stride, a.size, b.size, first->own.data(), first->own.cols());
      } else if (a.at < 0) {
        addBlock(block, stride, a.size, b.size, &first->cross(0, b.local), first->cross.cols());
      } else if (b.at < 0) {
        addTransposed(block, stride, a.size, b.size, &first->cross(0, a.local),
                      first->cross.cols());
      } else if (a.at <= b.at) {
        addBlock(block, stride, a.size, b.size, &rest_(a.at, b.at), rest_.cols());
      } else {
        addTransposed(block, stride, a.size, b.size, &rest_(b.at, a.at), rest_.cols());
      }
    }
  }
}

Eigen::VectorXd ArrowEquations::gradient() const {
  Eigen::VectorXd out = Eigen::VectorXd::Zero(count_);
  out(columns_) = gradient_;
  for (const Eliminated& one : shapes_or_tags_) out.segment(one.column, one.size) = one.gradient;
  return out;
}

Eigen::VectorXd ArrowEquations::diagonal() const {
  Eigen::VectorXd out = Eigen::VectorXd::Zero(count_);
  out(columns_) = rest_.diagonal();
  for (const Eliminated& one : shapes_or_tags_) {
    out.segment(one.column, one.size) = one.own.diagonal();
  }
  return out;
}

Eigen::MatrixXd ArrowEquations::dense() const {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(count_, count_);
  out(columns_, columns_) = Eigen::MatrixXd(rest_.selfadjointView<Eigen::Upper>());
  for (const Eliminated& one : shapes_or_tags_) {
    out.block(one.column, one.column, one.size, one.size) = one.own.selfadjointView<Eigen::Upper>();
    for (std::size_t j = 0; j < one.at.size(); ++j) {
      const int column = columns_[one.at[j]];
      const auto cross = one.cross.col(static_cast<Eigen::Index>(j));
      out.block(one.column, column, one.size, 1) = cross;
      out.block(column, one.column, 1, one.size) = cross.transpose();
    }
  }
  return out;
}

bool ArrowEquations::factor(const Eigen::VectorXd& damping) {
  root_ = rest_;
  scaled_gradient_ = gradient_;
  root_.diagonal() += damping(columns_);
  for (Eliminated& one : shapes_or_tags_) {
    if (!one.active) continue;
    one.root = one.own;
    one.root.diagonal() += damping.segment(one.column, one.size);
    if (!factorUpper(one.root)) return false;
    one.scaled_cross = one.cross;
    divideByTransposed(one.root, one.scaled_cross);
    one.scaled_gradient = one.gradient;
    divideByTransposed(one.root, one.scaled_gradient);
    subtractSquare(one.scaled_cross, one.at, square_, root_);
    scaled_gradient_(one.at) -= one.scaledCross().transpose() * one.scaled_gradient;
  }
  return factorUpper(root_);
}

Eigen::VectorXd ArrowEquations::step() const {
  Eigen::VectorXd out = Eigen::VectorXd::Zero(count_);
  Eigen::VectorXd rest = -scaled_gradient_;
  solveUpper(root_, rest);
  out(columns_) = rest;
  for (const Eliminated& one : shapes_or_tags_) {
    if (!one.active) continue;
    Eigen::VectorXd own = -one.scaled_gradient;
    own.noalias() -= one.scaledCross() * rest(one.at);
    divideByRootOnly(one.root, own);
    out.segment(one.column, one.size) = own;
  }
  return out;
}

RowMajor ArrowEquations::reducedInverse() const { return inverseOfUpper(root_); }

double ArrowEquations::inverseTrace(const Eigen::VectorXd& weights, const RowMajor& reduced) const {
  double trace = 0;
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    trace += weights[columns_[i]] * reduced(row, row);
  }
  for (const Eliminated& one : shapes_or_tags_) {
    if (!one.active) continue;
    RowMajor by_rest = one.scaledCross();
    divideByRootOnly(one.root, by_rest);
    const RowMajor own = inverseOfUpper(one.root);
    const RowMajor own_reduced = reduced(one.at, one.at);
    const RowMajor spread = by_rest * own_reduced;
    const Eigen::VectorXd variances = own.diagonal() + spread.cwiseProduct(by_rest).rowwise().sum();
    trace += variances.dot(weights.segment(one.column, one.size));
  }
  return trace;
}

Eigen::MatrixXd ArrowEquations::reduced() const {
  RowMajor out = rest_;
  std::vector<double> square;
  for (const Eliminated& one : shapes_or_tags_) {
    if (one.active) subtractSquare(one.scaled_cross, one.at, square, out);
  }
  return out.selfadjointView<Eigen::Upper>();
}

}  // namespace helix_arm::estimation
