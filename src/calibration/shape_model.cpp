#include "shape_model.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "basics/vector_clones.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"

namespace helix_arm::estimation {
namespace {

// Step of the central differences of the logs, for arms with pieces; their error is of second
// order.
constexpr double kStep = 1e-4;
// Initial bending stiffness of an arm without one, in squares of its actuators' offset.
constexpr double kLikelyBending = 0.2;

int count(const model::Arm& arm, int k) { return arm.firstActuator(k + 1) - arm.firstActuator(k); }

// Change of the pieces' twists, all in one column.
Eigen::VectorXd changeOf(const statics::Solution& above, const statics::Solution& below) {
  const model::Shape::Pieces change = (above.shape.pieces() - below.shape.pieces()) / (2 * kStep);
  return Eigen::Map<const Eigen::VectorXd>(change.data(), change.size());
}

// Whether its shapes are solved, not linear in the lengths.
bool hasPieces(const ArmCaptures& arm) { return arm.isLoaded() || !arm.arm.isLinear(); }

bool isAlike(const model::Arm& arm) {
  const model::Stiffness& first = arm.actuator(0).stiffness;
  for (int i = 1; i < arm.actuatorCount(); ++i) {
    const model::Stiffness& other = arm.actuator(i).stiffness;
    if (other.kappa != first.kappa || other.gamma != first.gamma || other.tau != first.tau) {
      return false;
    }
  }
  return true;
}

}  // namespace

double& entryOf(Elasticity& elasticity, StiffnessEntry entry) {
  switch (entry) {
    case StiffnessEntry::kKappa:
      return elasticity.ratios.kappa;
    case StiffnessEntry::kGamma:
      return elasticity.ratios.gamma;
    case StiffnessEntry::kEps:
      return elasticity.K_eps;
    case StiffnessEntry::kTau:
      break;
  }
  return elasticity.ratios.tau;
}

ShapeModel::ShapeModel(const std::vector<ArmCaptures>& arms,
                       const std::vector<StiffnessEntry>& fitted)
    : arms_(arms), fitted_(fitted), loaded_(arms.size()) {
  const ArmCaptures& first = arms.front();
  initial_.ratios = first.arm.actuator(0).stiffness;
  const auto loaded =
      std::find_if(arms.begin(), arms.end(), [](const ArmCaptures& arm) { return arm.isLoaded(); });
  if (loaded != arms.end()) initial_.K_eps = loaded->load->K_eps.front();
  reference_ = initial_;
  model::Stiffness& ratios = reference_.ratios;
  double offset = 0;
  for (int i = 0; i < first.arm.actuatorCount(); ++i) {
    offset = std::max(offset, first.arm.actuator(i).X_O.translation.squaredNorm());
  }
  if (!(ratios.kappa > 0)) ratios.kappa = kLikelyBending * offset;
  if (!(ratios.gamma > 0)) ratios.gamma = 1.0;
  if (!(ratios.tau > 0)) ratios.tau = ratios.kappa;
}

Elasticity ShapeModel::elasticityAt(const double* logs, Elasticity elasticity) const {
  for (std::size_t e = 0; e < fitted_.size(); ++e) {
    double& entry = entryOf(elasticity, fitted_[e]);
    entry = (entry > 0 ? entry : referenceOf(fitted_[e])) * std::exp(logs[e]);
  }
  return elasticity;
}

ShapeThere ShapeModel::at(int a, const Eigen::VectorXd& lengths, const double* logs, int scales,
                          bool derivatives) {
  update(logs, derivatives);
  return hasPieces(arms_[a]) ? loaded(a, lengths, scales, derivatives)
                             : unloaded(a, lengths, scales, derivatives);
}

ShapeThere ShapeModel::unloaded(int a, const Eigen::VectorXd& lengths, int scales,
                                bool derivatives) const {
  const model::Arm& arm = arms_[a].arm;
  ShapeThere out;
  model::Twists twists(6, arm.sectionCount());
  if (derivatives) {
    out.by_stiffness.resize(6 * arm.sectionCount(), size());
    out.by_scale.setZero(6 * arm.sectionCount(), scales);
  }
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const auto l = lengths.segment(arm.firstActuator(k), count(arm, k));
    twists.col(k) = maps_[a][k].map * l;
    for (int e = 0; derivatives && e < size(); ++e) {
      out.by_stiffness.block<6, 1>(6 * k, e) = changes_[a][k][e] * l;
    }
    for (int j = 0; derivatives && scales > 0 && j < l.size(); ++j) {
      out.by_scale.block<6, 1>(6 * k, scales == 1 ? 0 : arm.firstActuator(k) + j) +=
          maps_[a][k].map.col(j) * l[j];
    }
  }
  out.shape = model::shapeOf(arm, twists);
  return out;
}

ShapeThere ShapeModel::loaded(int a, const Eigen::VectorXd& lengths, int scales, bool derivatives) {
  Loaded& arm = loaded_[a];
  if (arm.lengths.size() > 0 && arm.lengths == lengths && (arm.has_changes || !derivatives)) {
    return arm.last;
  }
  ShapeThere out;
  const auto found = [&out](const Statics& statics, const Eigen::VectorXd& l) {
    statics::Solution solution = statics(l);
    out.found &= solution.converged();
    return solution;
  };
  out.shape = found(arm.there, lengths).shape;
  if (derivatives) {
    out.by_stiffness.resize(out.shape.pieces().size(), size());
    out.by_scale.resize(out.shape.pieces().size(), scales);
    for (int e = 0; e < size(); ++e) {
      out.by_stiffness.col(e) =
          changeOf(found(arm.above[e], lengths), found(arm.below[e], lengths));
    }
    for (int i = 0; i < scales; ++i) {
      const auto scaled = [&](double log) {
        Eigen::VectorXd l = lengths;
        if (scales == 1) {
          l *= std::exp(log);
        } else {
          l[i] *= std::exp(log);
        }
        return l;
      };
      out.by_scale.col(i) =
          changeOf(found(arm.there, scaled(kStep)), found(arm.there, scaled(-kStep)));
    }
  }
  arm.lengths = lengths;
  arm.has_changes = derivatives;
  arm.last = out;
  return out;
}

std::vector<model::Strand<lie::SE3>> ShapeModel::strandsAt(int a, int k,
                                                           const Eigen::VectorXd& logs) const {
  const model::Arm& arm = arms_[a].arm;
  std::vector<model::Strand<lie::SE3>> strands;
  for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
    const model::Actuator& actuator = arm.actuator(i);
    strands.push_back(
        {actuator.X_O,
         elasticityAt(logs.data(), {actuator.stiffness, 0}).ratios.diagonal<lie::SE3>()});
  }
  return strands;
}

ShapeModel::Changes ShapeModel::changesAt(int a, int k) const {
  // A map = D, and D does not depend on the stiffness. Neither does the null space of A, since no
  // entry vanishes.
  const model::Arm& arm = arms_[a].arm;
  const model::Equilibrium<lie::SE3>& equilibrium = maps_[a][k];
  std::vector<lie::Matrix6> A(fitted_.size(), lie::Matrix6::Zero());
  for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
    const lie::Matrix6 Ad = arm.actuator(i).X_O.inverse().adjoint();
    const Elasticity now = elasticityAt(at_.data(), {arm.actuator(i).stiffness, 0});
    for (std::size_t e = 0; e < fitted_.size(); ++e) {
      Elasticity without = now;
      entryOf(without, fitted_[e]) = 0;
      const lie::Vector6 change =
          now.ratios.diagonal<lie::SE3>() - without.ratios.diagonal<lie::SE3>();
      A[e] += Ad.transpose() * change.asDiagonal() * Ad;
    }
  }
  Changes changes;
  for (const lie::Matrix6& by_log : A) {
    changes.emplace_back(-equilibrium.compliance * by_log * equilibrium.map);
  }
  return changes;
}

ShapeModel::Statics ShapeModel::staticsAt(const ArmCaptures& data,
                                          const Eigen::VectorXd& logs) const {
  const bool fits_ratios = std::any_of(fitted_.begin(), fitted_.end(), [](StiffnessEntry entry) {
    return entry != StiffnessEntry::kEps;
  });
  // An entry of 0 can only change if all actuators have the same ratios.
  const Elasticity factors = elasticityAt(logs.data(), {{1, 1, 1}, 1});
  const auto moved = [&](const model::Stiffness& own) {
    return elasticityAt(logs.data(), {own, 0}).ratios;
  };
  model::Arm arm = data.arm;
  if (fits_ratios) {
    try {
      arm = isAlike(data.arm) ? arm.withStiffness(moved(data.arm.actuator(0).stiffness))
                              : arm.scaledStiffness(factors.ratios);
    } catch (const std::invalid_argument&) {  // a taper that is too steep for this stiffness
      return [model = statics::ArmModel(data.arm)](const Eigen::VectorXd& lengths) {
        statics::Solution none = model.solveLengths(lengths);
        none.status = statics::SolveStatus::kUnsupported;
        return none;
      };
    }
  }
  std::optional<statics::Load> load = data.load;
  if (load) {
    for (double& K_eps : load->K_eps) K_eps *= factors.K_eps;
  }
  // Tags and cameras are in space, so the arm is, too.
  const statics::TierSetting setting = data.tier.tier == statics::Tier::kPlanar
                                           ? statics::TierSetting{statics::Tier::kLinear, 0}
                                           : data.tier;
  return [model = statics::ArmModel(std::move(arm), std::nullopt, std::move(load), setting)](
             const Eigen::VectorXd& lengths) { return model.solveLengths(lengths); };
}

void ShapeModel::update(const double* logs, bool derivatives) {
  const Eigen::VectorXd at = Eigen::Map<const Eigen::VectorXd>(logs, size());
  const bool known = !maps_.empty() && at_ == at;
  if (known && (has_changes_ || !derivatives)) return;
  if (!known) {
    maps_.assign(arms_.size(), {});
    for (std::size_t a = 0; a < arms_.size(); ++a) {
      for (int k = 0; k < arms_[a].arm.sectionCount(); ++k) {
        maps_[a].push_back(model::solveEquilibrium(strandsAt(static_cast<int>(a), k, at)));
      }
      if (hasPieces(arms_[a])) loaded_[a].there = staticsAt(arms_[a], at);
      loaded_[a].lengths.resize(0);
    }
  }
  at_ = at;
  has_changes_ = derivatives;
  if (!derivatives) return;
  changes_.assign(arms_.size(), {});
  for (std::size_t a = 0; a < arms_.size(); ++a) {
    if (!hasPieces(arms_[a])) {
      for (int k = 0; k < arms_[a].arm.sectionCount(); ++k) {
        changes_[a].push_back(changesAt(static_cast<int>(a), k));
      }
      continue;
    }
    loaded_[a].above.clear();
    loaded_[a].below.clear();
    for (int e = 0; e < size(); ++e) {
      const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(size(), e);
      loaded_[a].above.push_back(staticsAt(arms_[a], at + step));
      loaded_[a].below.push_back(staticsAt(arms_[a], at - step));
    }
  }
}

namespace {

// Rows per pass over the rest of a matrix: each of its entries is then read and written once for
// several products.
constexpr int kRowsAtOnce = 8;

// to[j] -= sum_k factor[k] rows[k][j]
inline __attribute__((always_inline)) void subtractRows(const double* rows, std::ptrdiff_t stride,
                                                        const double* factor, int size,
                                                        double* __restrict to) {
  const double *const a = rows, *const b = a + stride, *const c = b + stride, *const d = c + stride;
  const double *const e = d + stride, *const f = e + stride, *const g = f + stride,
                      *const h = g + stride;
  for (int j = 0; j < size; ++j) {
    to[j] -= (factor[0] * a[j] + factor[1] * b[j] + factor[2] * c[j] + factor[3] * d[j]) +
             (factor[4] * e[j] + factor[5] * f[j] + factor[6] * g[j] + factor[7] * h[j]);
  }
}

inline __attribute__((always_inline)) void subtractRow(const double* row, double factor, int size,
                                                       double* __restrict to) {
  for (int j = 0; j < size; ++j) to[j] -= factor * row[j];
}

HELIX_ARM_CLONES bool factorRows(double* S, int n) {
  for (int first = 0; first < n; first += kRowsAtOnce) {
    const int end = std::min(first + kRowsAtOnce, n);
    for (int k = first; k < end; ++k) {
      double* const row = S + static_cast<std::ptrdiff_t>(k) * n;
      for (int i = first; i < k; ++i) {
        const double* const above = S + static_cast<std::ptrdiff_t>(i) * n;
        subtractRow(above + k, above[k], n - k, row + k);
      }
      if (!(row[k] > 0)) return false;
      const double scale = 1 / std::sqrt(row[k]);
      for (int j = k; j < n; ++j) row[j] *= scale;
    }
    if (end - first < kRowsAtOnce) break;
    const double* const done = S + static_cast<std::ptrdiff_t>(first) * n;
    for (int i = end; i < n; ++i) {
      double factor[kRowsAtOnce];
      for (int k = 0; k < kRowsAtOnce; ++k) factor[k] = done[k * n + i];
      subtractRows(done + i, n, factor, n - i, S + static_cast<std::ptrdiff_t>(i) * n + i);
    }
  }
  return true;
}

// From the last row on: (U C)_ij = 0 for j > i and 1 / U_ii for j = i.
HELIX_ARM_CLONES void invertRows(const double* U, double* C, int n) {
  for (int i = n - 1; i >= 0; --i) {
    const double* const u = U + static_cast<std::ptrdiff_t>(i) * n;
    double* const c = C + static_cast<std::ptrdiff_t>(i) * n;
    std::fill(c + i, c + n, 0.0);
    int k = i + 1;
    for (; k + kRowsAtOnce <= n; k += kRowsAtOnce) {
      subtractRows(C + static_cast<std::ptrdiff_t>(k) * n + i + 1, n, u + k, n - i - 1, c + i + 1);
    }
    for (; k < n; ++k) {
      subtractRow(C + static_cast<std::ptrdiff_t>(k) * n + i + 1, u[k], n - i - 1, c + i + 1);
    }
    const double scale = 1 / u[i];
    double diagonal = scale;
    for (int j = i + 1; j < n; ++j) {
      c[j] *= scale;
      C[static_cast<std::ptrdiff_t>(j) * n + i] = c[j];
      diagonal -= u[j] * c[j];
    }
    c[i] = diagonal * scale;
  }
}

// As many as kRowPadding, in as few registers as the processor needs.
typedef double Chunk __attribute__((vector_size(8 * kRowPadding), aligned(8), may_alias));

HELIX_ARM_CLONES void squarePaddedRows(const double* W, int rows, int stride, int count,
                                       double weight, double* square) {
  for (int first = 0; first < stride; first += kRowPadding) {
    const int end = std::min(count, first + kRowPadding);
    for (int i = 0; i < end; ++i) {
      Chunk sum = {};
      for (int r = 0; r < rows; ++r) {
        const double* const row = W + r * stride;
        sum += row[i] * *reinterpret_cast<const Chunk*>(row + first);
      }
      *reinterpret_cast<Chunk*>(square + i * stride + first) = weight * sum;
    }
  }
}

HELIX_ARM_CLONES void divideRows(const double* U, int n, double* X, int stride) {
  for (int first = 0; first < stride; first += kRowPadding) {
    for (int i = 0; i < n; ++i) {
      Chunk& row = *reinterpret_cast<Chunk*>(X + i * stride + first);
      Chunk rest = row;
      for (int k = 0; k < i; ++k) {
        rest -= U[k * n + i] * *reinterpret_cast<const Chunk*>(X + k * stride + first);
      }
      row = rest * (1 / U[i * n + i]);
    }
  }
}

}  // namespace

bool factorUpper(RowMajor& S) { return factorRows(S.data(), static_cast<int>(S.rows())); }

void solveUpper(const RowMajor& U, Eigen::VectorXd& x) {
  divideByTransposed(U, x);
  const Eigen::Index n = U.rows();
  for (Eigen::Index i = n; i-- > 0;) {
    x[i] = (x[i] - U.row(i).tail(n - i - 1).dot(x.tail(n - i - 1))) / U(i, i);
  }
}

void divideByTransposed(const RowMajor& U, RowMajor& X) {
  divideRows(U.data(), static_cast<int>(U.rows()), X.data(), static_cast<int>(X.cols()));
}

void divideByTransposed(const RowMajor& U, Eigen::VectorXd& x) {
  const Eigen::Index n = U.rows();
  for (Eigen::Index i = 0; i < n; ++i) {
    x[i] /= U(i, i);
    x.tail(n - i - 1) -= x[i] * U.row(i).tail(n - i - 1).transpose();
  }
}

RowMajor inverseOfUpper(const RowMajor& U) {
  RowMajor C(U.rows(), U.cols());
  invertRows(U.data(), C.data(), static_cast<int>(U.rows()));
  return C;
}

void squareRows(const double* W, int rows, int stride, int count, double weight, double* square) {
  squarePaddedRows(W, rows, stride, count, weight, square);
}

void subtractSquare(const RowMajor& W, const std::vector<int>& at, std::vector<double>& square,
                    RowMajor& S) {
  const int count = static_cast<int>(at.size()), stride = static_cast<int>(W.cols());
  square.resize(static_cast<std::size_t>(count * stride));
  squareRows(W.data(), static_cast<int>(W.rows()), stride, count, 1, square.data());
  for (int i = 0; i < count; ++i) {
    double* const out = &S(at[i], 0);
    const double* const row = &square[static_cast<std::size_t>(i * stride)];
    for (int j = i; j < count; ++j) out[at[j]] -= row[j];
  }
}

}  // namespace helix_arm::estimation
