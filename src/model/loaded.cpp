#include "helix_arm/model/loaded.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <utility>

#include "anderson.hpp"
#include "buckling.hpp"
#include "compliance.hpp"
#include "gauss_rule.hpp"
#include "helix_arm/model/requirement.hpp"
#include "loaded_limits.hpp"
#include "twist_near.hpp"
#include "wrench.hpp"

namespace helix_arm::model {
namespace {

constexpr int kMaxIterations = 100;
constexpr double kAtRest = 1e-11;  // last change, relative to the arm's size and one radian
// The step of the least order is trusted where the next one would be shorter by this factor, and no
// longer than this, relative to the arm's size and one radian.
constexpr double kContracting = 0.5;
constexpr double kTrustedStep = 0.02;
// Turn of a section against its shape without load, beyond which its coordinates fold back [rad].
constexpr double kFarthestTurn = 5.5;
constexpr double kFarthestResidual = 1e6;
constexpr double kNoWork = 1e-9;          // of a wrench on a null space, relative to the load's
constexpr double kDifferenceStep = 1e-4;  // relative to the arm's size and to one radian
constexpr double kOutOfPlane = 1e-9;      // rounding of a base's rotation
constexpr int kKrylov = 8;                // motions that stability is judged by
constexpr double kKrylovStep = 1e-6;      // of them, relative to the arm's size and one radian

bool inXY(const Eigen::Vector3d& v) { return std::abs(v.z()) <= kOutOfPlane * v.norm(); }

using Projection = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor,
                                 kKrylov + 1, kKrylov + 1>;

// Whether all eigenvalues are finite and their real parts at most 1.
bool hasNoneAboveOne(const Projection& H) {
  if (!H.allFinite()) return false;
  const Eigen::EigenSolver<Projection> solver(H, false);
  return (solver.eigenvalues().real().array() <= 1.0).all();
}

}  // namespace

bool inPlane(const Load& load) {
  const bool weighs =
      std::any_of(load.mass.begin(), load.mass.end(), [](double m) { return m > 0; });
  if (weighs && !inXY(load.gravity)) return false;
  return std::all_of(load.points.begin(), load.points.end(), [&load](const PointLoad& point) {
    const Eigen::Vector3d force = load.forceOf(point);
    return inXY(force) && (force.isZero(0) || inXY(point.offset)) &&
           point.moment.head<2>().norm() <= kOutOfPlane * point.moment.norm();
  });
}

bool staysInPlane(const Arm& arm, const Load& load) {
  load.validate(arm.sectionCount());
  return inPlane(load) && bucklingBound(arm, load) < 1.0;
}

// One solution: everything lives on the stack.
template <class Group>
template <int kNodes>
class LoadedArmOf<Group>::Relaxation {
 public:
  static constexpr int kDof = Group::kDof;
  static constexpr int kRates = kDof * kNodes;  // of an element
  using Tangent = typename Group::Tangent;
  using Point = typename Group::Point;
  using Points = Eigen::Matrix<double, Group::kSpace, kNodes>;
  using Rates =
      Eigen::Matrix<double, kDof, Eigen::Dynamic, Eigen::ColMajor, kDof, kNodes * kMaxElements>;

  Relaxation(const LoadedArmOf& arm, const Load& load, const Twists& unloaded)
      : arm_(arm), load_(load), rule_(GaussRule<kNodes>::get()), count_(elementCount(arm)) {
    scale_ << Eigen::Matrix<double, Group::kSpace, 1>::Constant(1.0 / arm.size_),
        Eigen::Matrix<double, Group::kRotations, 1>::Ones();
    for (int e = 0; e < count_; ++e) {
      const Element& element = arm.elements_[e];
      twist_[e] = element.length * unloaded.col(element.section);
      for (int j = 0; j < kNodes; ++j) {
        const Group X = Group::exp(rule_.nodes()[j] * twist_[e]);
        rotation_[e * kNodes + j] = X.rotation;
        translation_[e * kNodes + j] = X.translation;
      }
    }
    rates_.setZero(kDof, kNodes * count_);
  }

  // Begins where another solution ended.
  void startFrom(const Relaxation& other) { rates_ = other.rates_; }

  // Out of line: it is called from all over, and long.
  [[gnu::noinline]] void run(bool one_step) {
    if (one_step) {
      takeOneStep();
    } else {
      iterate();
    }
    if (status_ == SolveStatus::kConverged && !supported()) status_ = SolveStatus::kUnsupported;
    if (!tip_.translation.allFinite()) status_ = SolveStatus::kNotConverged;
  }

  // A shape that balances but would not stay is not converged.
  void refuseUnstable() {
    if (status_ == SolveStatus::kConverged && !stable()) status_ = SolveStatus::kNotConverged;
  }

  TipOf<Group> result() const { return {tip_, status_, residual_, iterations_}; }

  // Pose at t in [0, 1] of an element, seen from the base.
  Group poseAt(int e, double t) const {
    const Tangent z = rates_.template middleCols<kNodes>(e * kNodes) * rule_.upTo(t);
    return start_[e] * Group::exp(z) * Group::exp(t * twist_[e]);
  }

  Shape shape(int sections) const {
    Shape::Pieces pieces(6, sections * kLoadedPieces);
    lie::SE3 before;
    int e = 0;
    for (int piece = 0; piece < pieces.cols(); ++piece) {
      const int k = piece / kLoadedPieces;
      const double s = static_cast<double>(piece % kLoadedPieces + 1) / kLoadedPieces;
      while (e + 1 < count_ && (arm_.elements_[e].section < k ||
                                arm_.elements_[e].begin + arm_.elements_[e].length < s)) {
        ++e;
      }
      const Element& element = arm_.elements_[e];
      const lie::SE3 X = inSpace(poseAt(e, std::min((s - element.begin) / element.length, 1.0)));
      const Eigen::Vector3d turn = inSpace(twist_[e]).template tail<3>() / element.length;
      pieces.col(piece) = twistNear(before.inverse() * X, turn / kLoadedPieces);
      before = X;
    }
    return {pieces, kLoadedPieces};
  }

 private:
  static int elementCount(const LoadedArmOf& arm) { return static_cast<int>(arm.elements_.size()); }

  // Rates that balance the load on the shape that rates_ make; start_ and tip_ are of that shape.
  [[gnu::noinline]] void evaluate(Rates& out) {
    out.resize(kDof, rates_.cols());
    Group X;
    farthest_ = 0.0;
    for (int e = 0; e < count_; ++e) {
      start_[e] = X;
      const auto u = rates_.template middleCols<kNodes>(e * kNodes);
      const Eigen::Matrix<double, kDof, kNodes> z = u * rule_.before();
      for (int j = 0; j < kNodes; ++j) {
        const int node = e * kNodes + j;
        const Group X_j = X * Group::exp(z.col(j)) * Group{rotation_[node], translation_[node]};
        at_rotation_[node] = X_j.rotation;
        at_[node] = X_j.translation;
        z_[node] = z.col(j);
        farthest_ = std::max(farthest_, z.col(j).template tail<Group::kRotations>().norm());
      }
      X = X * Group::exp(u * rule_.weights()) * Group::exp(twist_[e]);
    }
    tip_ = X;

    Tangent W = Tangent::Zero();  // of all that pulls beyond, about the base's origin
    for (int e = count_ - 1; e >= 0; --e) {
      const Element& element = arm_.elements_[e];
      const Group& end = e + 1 < count_ ? start_[e + 1] : tip_;
      for (const int p : element.points) {
        const PointLoad& point = load_.points[p];
        const Point force = within<Group>(load_.forceOf(point));
        add(force,
            momentOf(end * within<Group>(point.offset), force) + turningWithin<Group>(point.moment),
            W);
      }
      const Point weight =
          within<Group>(element.length * load_.mass[element.section] * load_.gravity);
      Points x;
      for (int j = 0; j < kNodes; ++j) x.col(j) = at_[e * kNodes + j];
      const Points beyond = x * rule_.after();
      for (int j = 0; j < kNodes; ++j) {
        const int node = e * kNodes + j;
        Tangent W_j = W;
        add((1.0 - rule_.nodes()[j]) * weight, momentOf(beyond.col(j), weight), W_j);
        wrench_[node] = seenFrom<Group>({at_rotation_[node], at_[node]}, W_j);
        const Tangent strain = element.length * (arm_.compliance_[element.section] * wrench_[node]);
        out.col(node) = Group::solveRightJacobian(
            z_[node], moved(Group{rotation_[node], translation_[node]}, strain));
      }
      add(weight, momentOf(x * rule_.weights(), weight), W);
    }
    pull_ = W.template head<Group::kSpace>().norm() * arm_.size_ +
            W.template tail<Group::kRotations>().norm();
  }

  static void add(const Point& force, const Moment<Group>& moment, Tangent& W) {
    W.template head<Group::kSpace>() += force;
    W.template tail<Group::kRotations>() += moment;
  }

  void finish(SolveStatus status) {
    status_ = farthest_ < kFarthestTurn ? status : SolveStatus::kNotConverged;
  }

  // From the shape without load, then once more on the shape that gives; what further steps would
  // do is told from the first two (Aitken: each is the one before, times the same factor).
  void takeOneStep() {
    Rates next;
    evaluate(next);
    const Rates first = next;
    rates_ = first;
    evaluate(next);
    iterations_ = 2;
    double first_square = 0.0, step_square = 0.0, product = 0.0;
    for (int node = 0; node < first.cols(); ++node) {
      const Tangent one = scale_.cwiseProduct(first.col(node));
      const Tangent step = scale_.cwiseProduct(next.col(node) - first.col(node));
      first_square += one.squaredNorm();
      step_square += step.squaredNorm();
      product += one.dot(step);
    }
    residual_ = std::sqrt(step_square);
    const double factor = first_square > 0 ? product / first_square : 0.0;
    rates_ = next;
    rates_ += factor / (1.0 - factor) * (next - first);
    place();
    const double shorter = first_square > 0 ? residual_ / std::sqrt(first_square) : 0.0;
    const bool contracts = shorter <= kContracting && shorter * residual_ <= kTrustedStep;
    finish(contracts ? SolveStatus::kConverged : SolveStatus::kNotConverged);
  }

  // Starts of the elements and tip of the shape that rates_ make.
  void place() {
    Group X;
    for (int e = 0; e < count_; ++e) {
      start_[e] = X;
      X = X * Group::exp(rates_.template middleCols<kNodes>(e * kNodes) * rule_.weights()) *
          Group::exp(twist_[e]);
    }
    tip_ = X;
  }

  void iterate() {
    Rates answer;
    Rates weight = scale_.replicate(1, rates_.cols());
    Anderson<kMaxRates<kDof>> anderson(flat(weight));
    for (iterations_ = 1; iterations_ <= kMaxIterations; ++iterations_) {
      evaluate(answer);
      residual_ = anderson.advance(flat(rates_), flat(answer));
      if (residual_ <= kAtRest) {
        rates_ = answer;
        place();
        return finish(SolveStatus::kConverged);
      }
      if (!(residual_ < kFarthestResidual)) break;
    }
    iterations_ = std::min(iterations_, kMaxIterations);
    place();
    finish(SolveStatus::kNotConverged);
  }

  static Eigen::Map<Eigen::VectorXd> flat(Rates& rates) { return {rates.data(), rates.size()}; }

  // Whether the shape stays where it is: a change of strain must make the load ask for less change
  // than that. The iteration's derivative then has no eigenvalue above 1; the largest are those of
  // a Krylov space (Arnoldi).
  [[gnu::noinline]] bool stable() {
    using Basis = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor,
                                kRates * kMaxElements, kKrylov + 1>;
    Rates found = rates_, weight = scale_.replicate(1, rates_.cols()), answer, moved;
    evaluate(answer);
    const int size = static_cast<int>(found.size());
    int count = std::min(kKrylov, size);
    Basis basis(size, count + 1);
    // A motion of all kinds at all places.
    for (int i = 0; i < size; ++i) basis(i, 0) = std::sin(1.0 + 2.0 * i * i);
    basis.col(0).normalize();
    Projection H = Projection::Zero(count + 1, count + 1);
    for (int j = 0; j < count; ++j) {
      flat(rates_) = flat(found) + kKrylovStep * basis.col(j).cwiseQuotient(flat(weight));
      evaluate(moved);
      auto next = basis.col(j + 1);
      next = (flat(moved) - flat(answer)).cwiseProduct(flat(weight)) / kKrylovStep;
      for (int i = 0; i <= j; ++i) {
        H(i, j) = basis.col(i).dot(next);
        next -= H(i, j) * basis.col(i);
      }
      H(j + 1, j) = next.norm();
      if (!(H(j + 1, j) > kKrylovStep)) count = j + 1;
      next /= H(j + 1, j);
    }
    rates_ = found;
    place();
    return hasNoneAboveOne(H.topLeftCorner(count, count));
  }

  bool supported() const {
    for (int e = 0; e < count_; ++e) {
      const auto& free = arm_.null_space_[arm_.elements_[e].section];
      for (int j = 0; j < kNodes; ++j) {
        for (int i = 0; i < free.cols(); ++i) {
          if (std::abs(free.col(i).dot(wrench_[e * kNodes + j])) > kNoWork * pull_) return false;
        }
      }
    }
    return true;
  }

  const LoadedArmOf& arm_;
  const Load& load_;
  const GaussRule<kNodes>& rule_;
  int count_;
  Tangent scale_;
  Rates rates_;
  // Of the shape without load, in each element.
  Tangent twist_[kMaxElements];
  decltype(Group::rotation) rotation_[kNodes * kMaxElements];
  Point translation_[kNodes * kMaxElements];
  // Of the shape last evaluated.
  std::array<Group, kMaxElements> start_;
  decltype(Group::rotation) at_rotation_[kNodes * kMaxElements];
  Point at_[kNodes * kMaxElements];
  Tangent z_[kNodes * kMaxElements];
  Tangent wrench_[kNodes * kMaxElements];  // seen from the node
  double pull_ = 0.0;                      // of the whole load [N m]
  Group tip_;
  SolveStatus status_ = SolveStatus::kNotConverged;
  double residual_ = 0.0, farthest_ = 0.0;
  int iterations_ = 0;
};

namespace {

// Calls f with the number of nodes of an order as a constant.
template <class F>
auto withNodes(int order, const F& f) {
  switch (order) {
    case 2:
      return f(std::integral_constant<int, 3>());
    case 3:
      return f(std::integral_constant<int, 4>());
    case 4:
      return f(std::integral_constant<int, 5>());
    case 5:
      return f(std::integral_constant<int, 6>());
    case 6:
      return f(std::integral_constant<int, 7>());
    case 7:
      return f(std::integral_constant<int, 8>());
    default:
      return f(std::integral_constant<int, 9>());
  }
}

}  // namespace

template <class Group>
LoadedArmOf<Group>::LoadedArmOf(const ArmOf<Group>& arm, const Load& load, int order)
    : order_(order), load_(load), size_(arm.restLength()) {
  requireValue(order >= kLeastOrder && order <= kMostOrder, "loaded tier", "the order", order,
               "2 to 8");
  const int sections = arm.sectionCount();
  load.validate(sections);
  std::set<double> cuts;  // s over the whole arm
  for (const PointLoad& point : load.points) {
    if (point.s > 0 && point.s < 1) cuts.insert(point.section + point.s);
  }
  requireValue(
      load.innerPlaces() <= kMaxInnerPoints, "load.points", "the number of places inside sections",
      load.innerPlaces(),
      "at most 16 with tier: loaded; put points that are close to each other in one place, "
      "or use tier: exact");
  for (int k = 0; k <= sections; ++k) cuts.insert(k);
  for (auto begin = cuts.begin(), end = std::next(begin); end != cuts.end(); ++begin, ++end) {
    const int section = std::min(static_cast<int>(*begin), sections - 1);
    Element element{section, *begin - section, *end - *begin, {}};
    for (std::size_t p = 0; p < load.points.size(); ++p) {
      if (load.points[p].section + load.points[p].s == *end) {
        element.points.push_back(static_cast<int>(p));
      }
    }
    elements_.push_back(std::move(element));
  }
  for (int k = 0; k < sections; ++k) {
    compliance_.push_back(complianceOf(arm, load, k));
    null_space_.push_back(arm.equilibrium(k).null_space);
  }
  may_buckle_ = bucklingBound(arm, load) >= 1.0;
}

template <class Group>
template <class Solver>
Solver LoadedArmOf<Group>::solved(const Load& load, const Twists& unloaded,
                                  const Solver* near) const {
  Solver solver(*this, load, unloaded);
  if (near != nullptr && order_ != kLeastOrder) solver.startFrom(*near);
  solver.run(order_ == kLeastOrder);
  // What is near a shape that holds is as good as it.
  if (may_buckle_ && near == nullptr) solver.refuseUnstable();
  return solver;
}

template <class Group>
void LoadedArmOf<Group>::Response::add(int column, double step, const TipOf<Group>& below,
                                       const TipOf<Group>& above) {
  if (!below.converged()) at.status = below.status;
  if (!above.converged()) at.status = above.status;
  by.col(column) = (below.tip.inverse() * above.tip).log() / (2.0 * step);
}

template <class Group>
TipOf<Group> LoadedArmOf<Group>::tip(const Twists& unloaded) const {
  return withNodes(order_, [&](auto nodes) {
    return solved<Relaxation<nodes()>>(load_, unloaded, nullptr).result();
  });
}

template <class Group>
Solution LoadedArmOf<Group>::solve(const Twists& unloaded) const {
  return withNodes(order_, [&](auto nodes) {
    const auto relaxation = solved<Relaxation<nodes()>>(load_, unloaded, nullptr);
    const TipOf<Group> found = relaxation.result();
    return Solution{relaxation.shape(static_cast<int>(unloaded.cols())), inSpace(found.tip),
                    found.status, found.residual, found.iterations};
  });
}

template <class Group>
typename LoadedArmOf<Group>::Response LoadedArmOf<Group>::tipByUnloaded(
    const Twists& unloaded, const Eigen::MatrixXd& directions) const {
  return withNodes(order_, [&](auto nodes) {
    using Solver = Relaxation<nodes()>;
    const Solver here = solved<Solver>(load_, unloaded, nullptr);
    Response out{here.result(), Motion::Zero(Group::kDof, directions.cols())};
    for (int d = 0; d < directions.cols(); ++d) {
      const auto direction = directions.col(d).reshaped(Group::kDof, unloaded.cols());
      const double size = std::max(direction.template topRows<Group::kSpace>().norm() / size_,
                                   direction.template bottomRows<Group::kRotations>().norm());
      if (size == 0) continue;
      const double step = kDifferenceStep / size;
      out.add(d, step, solved<Solver>(load_, unloaded - step * direction, &here).result(),
              solved<Solver>(load_, unloaded + step * direction, &here).result());
    }
    return out;
  });
}

template <class Group>
typename LoadedArmOf<Group>::Response LoadedArmOf<Group>::tipByLoad(const Twists& unloaded) const {
  // A moment and a force that turn the softest section by about one radian.
  double softest = 0.0;
  for (const auto& C : compliance_) {
    softest = std::max(softest,
                       C.template bottomRightCorner<Group::kRotations, Group::kRotations>().norm());
  }
  const double moment = 1.0 / softest, force = moment / size_, pull = load_.gravity.norm();
  const double mass = pull > 0 ? force / pull : 1.0;
  // In the order of the columns, each with its unit.
  Load load = load_;
  std::vector<std::pair<double*, double>> entries;
  for (double& of_section : load.mass) entries.emplace_back(&of_section, mass);
  for (PointLoad& point : load.points) {
    entries.emplace_back(&point.mass, mass);
    for (int i = 0; i < 3; ++i) entries.emplace_back(&point.force[i], force);
    for (int i = 0; i < 3; ++i) entries.emplace_back(&point.moment[i], moment);
  }
  return withNodes(order_, [&](auto nodes) {
    using Solver = Relaxation<nodes()>;
    const Solver here = solved<Solver>(load, unloaded, nullptr);
    Response out{here.result(),
                 Motion::Zero(Group::kDof, static_cast<Eigen::Index>(entries.size()))};
    for (std::size_t i = 0; i < entries.size(); ++i) {
      const auto [entry, unit] = entries[i];
      const double kept = *entry, step = kDifferenceStep * unit;
      *entry = kept - step;
      const TipOf<Group> below = solved<Solver>(load, unloaded, &here).result();
      *entry = kept + step;
      const TipOf<Group> above = solved<Solver>(load, unloaded, &here).result();
      *entry = kept;
      out.add(static_cast<int>(i), step, below, above);
    }
    return out;
  });
}

template class LoadedArmOf<lie::SE2>;
template class LoadedArmOf<lie::SE3>;

}  // namespace helix_arm::model
