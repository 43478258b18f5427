#include "helix_arm/dynamics/moving_arm.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>

#include "helix_arm/basics/requirement.hpp"
#include "span.hpp"
#include "statics/loaded/gauss_rule.hpp"

namespace helix_arm::dynamics {
namespace {

using basics::require;
using lie::SE2;
using lie::SE3;
using model::bracket;

// Gauss points of a section's mass for strain of degree 0; one more for each degree.
constexpr int kPoints = 5;
// Places of the two Gauss points of a Magnus step of order 4, from its middle.
const double kMagnusPlace = std::sqrt(3.0) / 6.0;
const double kMagnusTurn = std::sqrt(3.0) / 12.0;

template <class Group>
using MapOf = decltype(identityOf(Group()));

template <class Group>
using Coefficients = Eigen::Map<const Eigen::Matrix<double, Group::kDof, Eigen::Dynamic>>;

// The wrench of a force [N] at a place and a moment [N m], all seen from the node.
lie::Vector6 wrenchOf(const Eigen::Vector3d& force, const Eigen::Vector3d& place,
                      const Eigen::Vector3d& moment) {
  lie::Vector6 out;
  out << force, place.cross(force) + moment;
  return out;
}
SE2::Tangent wrenchOf(const Eigen::Vector2d& force, const Eigen::Vector2d& place,
                      const Eigen::Matrix<double, 1, 1>& moment) {
  return {force.x(), force.y(), place.x() * force.y() - place.y() * force.x() + moment[0]};
}

// ad_eta^T of a momentum, with the sign of the force that turns it.
lie::Vector6 turning(const lie::Vector6& eta, const lie::Vector6& momentum) {
  const Eigen::Vector3d v = eta.head<3>(), w = eta.tail<3>(), p = momentum.head<3>();
  lie::Vector6 out;
  out << w.cross(p), v.cross(p) + w.cross(Eigen::Vector3d(momentum.tail<3>()));
  return out;
}
SE2::Tangent turning(const SE2::Tangent& eta, const SE2::Tangent& momentum) {
  return {-eta[2] * momentum[1], eta[2] * momentum[0], eta[0] * momentum[1] - eta[1] * momentum[0]};
}

// Moments in space have no direction of their own in the node; in a plane they need none.
Eigen::Vector3d seenFrom(const SE3& X, const Eigen::Vector3d& moment) {
  return X.rotation.transpose() * moment;
}
Eigen::Matrix<double, 1, 1> seenFrom(const SE2&, const Eigen::Matrix<double, 1, 1>& moment) {
  return moment;
}

// m diag(1, 1, 1, r^2, r^2 / 2, r^2 / 2), and its part in the plane.
lie::Vector6 inertiaOf(const SE3&, double m, double r) {
  lie::Vector6 out;
  out << m, m, m, m * r * r, m * r * r / 2, m * r * r / 2;
  return out;
}
SE2::Tangent inertiaOf(const SE2&, double m, double r) { return {m, m, m * r * r / 2}; }

// Inertia of a point of mass m at a place.
lie::Matrix6 pointInertia(double m, const Eigen::Vector3d& place) {
  lie::Matrix6 out;
  const Eigen::Matrix3d P = lie::skew(place);
  out << Eigen::Matrix3d::Identity(), -P, P, -P * P;
  return m * out;
}
Eigen::Matrix3d pointInertia(double m, const Eigen::Vector2d& place) {
  Eigen::Matrix3d out;
  out << 1, 0, -place.y(), 0, 1, place.x(), -place.y(), place.x(), place.squaredNorm();
  return m * out;
}

lie::Vector6 timesOf(const SE3&, const StrainTimes& times) {
  lie::Vector6 out;
  out << times.stretch, times.shear, times.shear, times.twist, times.bend, times.bend;
  return out;
}
SE2::Tangent timesOf(const SE2&, const StrainTimes& times) {
  return {times.stretch, times.shear, times.bend};
}

// Legendre polynomial of a degree on [0, 1].
double legendre(int degree, double s) {
  const double x = 2 * s - 1;
  double last = 0.0, value = 1.0;
  for (int i = 0; i < degree; ++i) {
    const double next = ((2 * i + 1) * x * value - i * last) / (i + 1);
    last = value;
    value = next;
  }
  return value;
}

std::shared_ptr<const model::Links> linksInSpace(const model::Arm& arm) { return arm.links(); }
std::shared_ptr<const model::Links> linksInSpace(const model::PlanarArm& arm) {
  return model::embed(arm).links();
}

// An inertia seen from B, seen from A.
template <class Group, class Matrix>
Matrix inertiaFrom(const Group& X_AB, const Matrix& inertia) {
  const Matrix half = carried(X_AB, inertia).transpose();
  return carried(X_AB, half);
}

template <class Group>
double meanRadius(const model::ArmOf<Group>& arm, int k) {
  double sum = 0.0;
  for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
    sum += arm.actuator(i).X_O.translation.norm();
  }
  return sum / (arm.firstActuator(k + 1) - arm.firstActuator(k));
}

// Jr times the derivatives of a stretch's twist by the coefficients of its section.
template <class Group, class Mark>
void derivativesOf(const Mark& mark, const Coefficients<Group>& g, const MapOf<Group>& Jr,
                   MapOf<Group>* by) {
  const double h = mark.length;
  if (g.cols() == 1) {
    by[0] = h * Jr;
    return;
  }
  MapOf<Group> by_strain[2];  // at the two Gauss points
  for (int i = 0; i < 2; ++i) {
    typename Group::Tangent other = Group::Tangent::Zero();
    for (int m = 0; m < g.cols(); ++m) other += mark.values[1 - i][m] * g.col(m);
    MapOf<Group> turned = (i == 0 ? -kMagnusTurn : kMagnusTurn) * h * h * bracketMatrix(other);
    turned += 0.5 * h * identityOf(Group());
    by_strain[i] = Jr * turned;
  }
  for (int m = 0; m < g.cols(); ++m) {
    by[m] = mark.values[0][m] * by_strain[0];
    by[m] += mark.values[1][m] * by_strain[1];
  }
}

}  // namespace

void MotionConfig::validate() const {
  basics::requireNotNegative("dynamics", {{"damping_s.stretch", damping.stretch},
                                          {"damping_s.shear", damping.shear},
                                          {"damping_s.twist", damping.twist},
                                          {"damping_s.bend", damping.bend}});
  if (inertia_radius) basics::requirePositive("dynamics", "inertia_radius_m", *inertia_radius);
  basics::requirePositive("dynamics", "step_s", step);
  basics::requireValue(order >= 0 && order <= kMostOrder, "dynamics", "order", order, "0 to 4");
}

template <class Group>
MovingArmOf<Group>::MovingArmOf(const model::ArmOf<Group>& arm, const statics::Load& load,
                                const MotionConfig& config)
    : arm_(arm),
      config_(config),
      modes_(config.order + 1),
      gravity_(load.gravity.head<Group::kSpace>()) {
  config.validate();
  load.validate(arm.sectionCount());
  require(arm.isLinear() && load.tables.empty(),
          "motion needs sections without taper, and stiffness that does not depend on pressure");
  constexpr int kDof = Group::kDof;
  const int n = kDof * modes_ * arm.sectionCount();
  stiffness_.setZero(n, n);
  damping_.setZero(n, n);
  const statics::Load at_ends = load.atEnds(linksInSpace(arm).get());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    Matrix K = Matrix::Zero(), D = Matrix::Zero();
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      const Matrix Ad = arm.actuator(i).X_O.inverse().adjoint();
      const Tangent stiffness = arm.actuator(i).stiffness.template diagonal<Group>();
      const Tangent damping = stiffness.cwiseProduct(timesOf(Group(), config.damping));
      K += Ad.transpose() * stiffness.asDiagonal() * Ad;
      D += Ad.transpose() * damping.asDiagonal() * Ad;
    }
    const double scale = load.K_eps[static_cast<std::size_t>(k)] / arm.freeLength(k);
    for (int mode = 0; mode < modes_; ++mode) {
      const int at = kDof * (modes_ * k + mode);
      const double share = scale / (2 * mode + 1);  // the polynomial's mean square
      stiffness_.block<kDof, kDof>(at, at) = share * K;
      damping_.block<kDof, kDof>(at, at) = share * D;
    }
    sections_.push_back({marksOf(k, at_ends), arm.link(k), arm.links() != nullptr});
    first_node_.push_back(nodes_);
    nodes_ += static_cast<int>(sections_.back().marks.size());
  }
}

template <class Group>
std::vector<typename MovingArmOf<Group>::Mark> MovingArmOf<Group>::marksOf(
    int k, const statics::Load& load) const {
  const double mass = load.mass[static_cast<std::size_t>(k)];
  const double radius = config_.inertia_radius.value_or(meanRadius(arm_, k));
  require(mass > 0, "motion needs `load.mass_kg` > 0 in every section; that of section ", k + 1,
          " is 0");
  require(radius > 0,
          "motion needs `dynamics.inertia_radius_m` where all actuators of a section "
          "are on its axis, as in section ",
          k + 1);
  std::vector<Mark> marks{{1.0}};
  const auto& rule = statics::GaussRule::of(kPoints + config_.order);
  for (int i = 0; i < rule.count(); ++i) {
    const double m = mass * rule.weights()[i];
    marks.push_back({rule.nodes()[i], inertiaOf(Group(), m, radius).asDiagonal(), m});
  }
  for (const statics::PointLoad& point : load.points) {
    if (point.section != k) continue;
    Mark& mark = point.s < 1 ? marks.emplace_back(Mark{point.s}) : marks.front();
    const Point place = point.offset.template head<Group::kSpace>();
    mark.inertia += pointInertia(point.mass, place);
    mark.mass += point.mass;
    mark.moment_of_mass += point.mass * place;
    if (point.force.isZero(0) && point.moment.isZero(0)) continue;
    mark.pulls.push_back({point.force.template head<Group::kSpace>(),
                          point.moment.template tail<Group::kRotations>(), place});
  }
  std::sort(marks.begin(), marks.end(),
            [](const Mark& one, const Mark& other) { return one.s < other.s; });
  double from = 0.0;
  for (Mark& mark : marks) {
    mark.length = mark.s - from;
    for (int i = 0; i < 2; ++i) {
      const double place = i == 0 ? 0.5 - kMagnusPlace : 0.5 + kMagnusPlace;
      for (int mode = 0; mode < modes_; ++mode) {
        mark.values[i][mode] = legendre(mode, from + place * mark.length);
      }
    }
    from = mark.s;
  }
  return marks;
}

template <class Group>
struct MovingArmOf<Group>::Terms::Memory {
  // Quantities at a mark.
  struct Node {
    Group X;                         // seen from the section's base
    MapOf<Group> L[kMostOrder + 1];  // body velocity by the rates of the section's coordinates
    Tangent wrench;                  // that inertia, Coriolis terms and loads take
  };
  std::vector<Node> nodes;
  std::vector<Matrix> beyond;  // momentum of all beyond, by the rates of the coordinates there
};

template <class Group>
MovingArmOf<Group>::Terms::Terms(const MovingArmOf& arm)
    : mass(Eigen::MatrixXd::Zero(arm.coordinates(), arm.coordinates())),
      force(Eigen::VectorXd::Zero(arm.coordinates())),
      memory_(new Memory{
          std::vector<typename Memory::Node>(static_cast<std::size_t>(arm.nodes_)),
          std::vector<Matrix>(static_cast<std::size_t>(arm.coordinates() / Group::kDof))}) {}

template <class Group>
MovingArmOf<Group>::Terms::~Terms() = default;

template <class Group>
void MovingArmOf<Group>::setTwists(const model::TwistsOf<Group>& twists, Eigen::VectorXd& q) const {
  q.setZero(coordinates());
  for (int k = 0; k < twists.cols(); ++k) {
    q.segment<Group::kDof>(Group::kDof * modes_ * k) = twists.col(k);
  }
}

// A Magnus step of order 4: W = h (g_1 + g_2) / 2 + sqrt(3) h^2 [g_1, g_2] / 12 of the strains at
// its two Gauss points. With strain of degree 0 it is exact.
template <class Group>
typename MovingArmOf<Group>::Stretch MovingArmOf<Group>::stretchOf(const Mark& mark,
                                                                   const double* q,
                                                                   const double* rate) const {
  const Coefficients<Group> g(q, Group::kDof, modes_), g_rate(rate, Group::kDof, modes_);
  const double h = mark.length;
  if (modes_ == 1) return {h * g.col(0), h * g_rate.col(0), Tangent::Zero()};
  Tangent at[2] = {Tangent::Zero(), Tangent::Zero()}, by[2] = {Tangent::Zero(), Tangent::Zero()};
  for (int i = 0; i < 2; ++i) {
    for (int mode = 0; mode < modes_; ++mode) {
      at[i] += mark.values[i][mode] * g.col(mode);
      by[i] += mark.values[i][mode] * g_rate.col(mode);
    }
  }
  const double turn = kMagnusTurn * h * h;
  return {0.5 * h * (at[0] + at[1]) + turn * bracket(at[0], at[1]),
          0.5 * h * (by[0] + by[1]) + turn * (bracket(by[0], at[1]) + bracket(at[0], by[1])),
          2.0 * turn * bracket(by[0], by[1])};
}

template <class Group>
typename Group::Tangent MovingArmOf<Group>::wrenchAt(const Mark& mark, const Group& X,
                                                     const Tangent& velocity,
                                                     const Tangent& acceleration,
                                                     double& power) const {
  if (!mark.loaded()) return Tangent::Zero();
  Tangent out = mark.inertia * acceleration + turning(velocity, Tangent(mark.inertia * velocity));
  for (const Pull& pull : mark.pulls) {
    const Moment moment = seenFrom(X, pull.moment);
    const Point force = X.rotation.transpose() * pull.force;
    out -= wrenchOf(force, pull.offset, moment);
    power += moment.dot(velocity.template tail<Group::kRotations>());
  }
  return out;
}

template <class Group>
void MovingArmOf<Group>::evaluate(const Eigen::VectorXd& q, const Eigen::VectorXd& rate,
                                  Terms& terms) const {
  Tangent velocity = Tangent::Zero(), acceleration = Tangent::Zero();
  acceleration.template head<Group::kSpace>() = -gravity_;  // as if the base fell up
  Group base;
  terms.moment_power = 0.0;
  MapOf<Group> by[kMostOrder + 1];
  auto* node = terms.memory_->nodes.data();
  for (std::size_t k = 0; k < sections_.size(); ++k) {
    const Section& section = sections_[k];
    const Eigen::Index at = Group::kDof * modes_ * static_cast<Eigen::Index>(k);
    const double *q_k = q.data() + at, *rate_k = rate.data() + at;
    Group X;
    for (std::size_t i = 0; i < section.marks.size(); ++i, ++node) {
      const Mark& mark = section.marks[i];
      const Stretch stretch = stretchOf(mark, q_k, rate_k);
      const Span<Group> span(stretch.twist, stretch.rate, true);
      const Tangent carry = back(span.X, velocity);
      acceleration = back(span.X, acceleration) + bracket(carry, span.own) + span.bias +
                     span.Jr * stretch.bias;
      velocity = carry + span.own;
      X = X * span.X;
      node->X = X;
      derivativesOf<Group>(mark, Coefficients<Group>(q_k, Group::kDof, modes_), span.Jr, by);
      for (int m = 0; m < modes_; ++m) {
        node->L[m] = by[m];
        if (i > 0) node->L[m] += back(span.X, (node - 1)->L[m]);
      }
      node->wrench = wrenchAt(mark, base * X, velocity, acceleration, terms.moment_power);
    }
    base = base * X;
    if (!section.has_link) continue;
    velocity = back(section.link, velocity);
    acceleration = back(section.link, acceleration);
    base = base * section.link;
  }
  assemble(terms);
}

// From the tip to the base: what is beyond a section is one rigid body at its end, whose momentum
// also depends on the rates there.
template <class Group>
void MovingArmOf<Group>::assemble(Terms& terms) const {
  constexpr int kDof = Group::kDof;
  auto& momentum = terms.memory_->beyond;
  Matrix beyond = Matrix::Zero();
  Tangent wrench = Tangent::Zero();
  for (int k = arm_.sectionCount() - 1; k >= 0; --k) {
    const Section& section = sections_[static_cast<std::size_t>(k)];
    const auto first = static_cast<std::size_t>(modes_ * k);
    const std::size_t later = first + static_cast<std::size_t>(modes_);
    const auto carryBack = [&](const Group& X) {
      beyond = inertiaFrom(X, beyond);
      wrench = carried(X, wrench);
      for (std::size_t b = later; b < momentum.size(); ++b) momentum[b] = carried(X, momentum[b]);
    };
    if (section.has_link) carryBack(section.link);
    const auto* const nodes =
        terms.memory_->nodes.data() + first_node_[static_cast<std::size_t>(k)];
    const auto& end = nodes[section.marks.size() - 1];
    for (int m = 0; m < modes_; ++m) {
      const Eigen::Index row = kDof * (modes_ * k + m);
      terms.force.template segment<kDof>(row) = end.L[m].transposeTimes(wrench);
      for (std::size_t b = later; b < momentum.size(); ++b) {
        terms.mass.template block<kDof, kDof>(row, kDof * static_cast<Eigen::Index>(b)) =
            end.L[m].transposeTimes(momentum[b]);
      }
      const Matrix of_beyond = end.L[m].leftTimes(beyond);
      for (int j = 0; j <= m; ++j) {
        terms.mass.template block<kDof, kDof>(kDof * (modes_ * k + j), row) =
            end.L[j].transposeTimes(of_beyond);
      }
      momentum[first + static_cast<std::size_t>(m)] = of_beyond;
    }
    carryBack(end.X);
    for (int m = 0; m < modes_; ++m) {
      Matrix& own = momentum[first + static_cast<std::size_t>(m)];
      own = carried(end.X, own);
    }
    for (std::size_t i = 0; i < section.marks.size(); ++i) {
      if (!section.marks[i].loaded()) continue;
      const Matrix& inertia = section.marks[i].inertia;
      for (int m = 0; m < modes_; ++m) {
        const Eigen::Index row = kDof * (modes_ * k + m);
        const Matrix moved = nodes[i].L[m].leftTimes(inertia);
        terms.force.template segment<kDof>(row) += nodes[i].L[m].transposeTimes(nodes[i].wrench);
        for (int j = 0; j <= m; ++j) {
          terms.mass.template block<kDof, kDof>(kDof * (modes_ * k + j), row) +=
              nodes[i].L[j].transposeTimes(moved);
        }
        if (k > 0) momentum[first + static_cast<std::size_t>(m)] += carried(nodes[i].X, moved);
      }
      if (k == 0) continue;
      beyond += inertiaFrom(nodes[i].X, inertia);
      wrench += carried(nodes[i].X, nodes[i].wrench);
    }
  }
  terms.mass.template triangularView<Eigen::StrictlyLower>() = terms.mass.transpose();
}

template <class Group>
typename MovingArmOf<Group>::Energies MovingArmOf<Group>::energies(
    const Eigen::VectorXd& q, const Eigen::VectorXd& rate) const {
  Energies out{0.0, 0.0};
  Tangent velocity = Tangent::Zero();
  Group X;
  for (std::size_t k = 0; k < sections_.size(); ++k) {
    const Section& section = sections_[k];
    const Eigen::Index at = Group::kDof * modes_ * static_cast<Eigen::Index>(k);
    for (const Mark& mark : section.marks) {
      const Stretch stretch = stretchOf(mark, q.data() + at, rate.data() + at);
      const Span<Group> span(stretch.twist, stretch.rate, false);
      velocity = back(span.X, velocity) + span.own;
      X = X * span.X;
      if (!mark.loaded()) continue;
      out.kinetic += 0.5 * velocity.dot(mark.inertia * velocity);
      out.potential -= gravity_.dot(mark.mass * X.translation + X.rotation * mark.moment_of_mass);
      for (const Pull& pull : mark.pulls) out.potential -= pull.force.dot(X * pull.offset);
    }
    if (section.has_link) {
      velocity = back(section.link, velocity);
      X = X * section.link;
    }
  }
  return out;
}

template <class Group>
Group MovingArmOf<Group>::tip(const Eigen::VectorXd& q) const {
  Group X;
  for (std::size_t k = 0; k < sections_.size(); ++k) {
    const double* q_k = q.data() + Group::kDof * modes_ * static_cast<Eigen::Index>(k);
    for (const Mark& mark : sections_[k].marks) {
      X = X * Group::exp(stretchOf(mark, q_k, q_k).twist);
    }
    X = X * sections_[k].link;
  }
  return X;
}

template class MovingArmOf<SE3>;
template class MovingArmOf<SE2>;

}  // namespace helix_arm::dynamics
