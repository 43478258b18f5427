#include "helix_arm/clearance/arm_clearance.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "basics/pi.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"
#include "obstacle.hpp"

namespace helix_arm::clearance {
namespace {

using Eigen::Vector3d;

constexpr double kSag = 1e-3;           // largest distance of a span from its chord, at first [m]
constexpr double kNearestSplit = 0.1;   // of a span, from its ends
constexpr double kStepsPerRadius = 15;  // of the curve, against itself
constexpr int kMostSteps = 400;
constexpr int kMarks = 8;  // per section

// A part of the base curve, X exp(t g) for t from 0 to 1, or a straight link.
struct Span {
  lie::SE3 X;
  lie::Vector6 g;
  Vector3d begin, end;
  double radius;
  double arc, length;  // from the base to its begin; its own [m]
  double sag = 0.0;    // largest distance from its chord [m]
  double turn = 0.0;   // of the tangent [rad]
  bool straight = false;

  Vector3d at(double t) const {
    if (straight) return begin + t * (end - begin);
    return (X * lie::SE3::exp(t * g)).translation;
  }
};

struct Body {
  std::vector<Span> spans;
  lie::SE3 X_BT;
  Vector3d centre;  // of a ball about all spans and their radii
  double ball = 0.0;
};

// Cuts piece g, which begins at X, into spans. @return where it ends.
lie::SE3 addPiece(const lie::SE3& X, const lie::Vector6& g, double radius, double& arc,
                  std::vector<Span>& spans) {
  const Vector3d v = g.head<3>(), w = g.tail<3>();
  const double bend = w.cross(v).norm();  // |d^2 p / dt^2|
  const int count = std::max(1, static_cast<int>(std::ceil(std::sqrt(bend / (8 * kSag)))));
  const lie::Vector6 part = g / count;
  const lie::SE3 step = lie::SE3::exp(part);
  const double length = v.norm() / count;
  const double turn = length > 0 ? bend / v.norm() / count : 0.0;
  lie::SE3 from = X;
  for (int i = 0; i < count; ++i) {
    const lie::SE3 to = from * step;
    spans.push_back({from, part, from.translation, to.translation, radius, arc, length,
                     bend / (8.0 * count * count), turn});
    arc += length;
    from = to;
  }
  return from;
}

Body bodyOf(const model::Shape& shape, const KeepOut& keep_out) {
  Body body;
  double arc = 0;
  lie::SE3 X;
  const int per_section = shape.piecesPerSection();
  const auto pieces = static_cast<int>(shape.pieces().cols());
  for (int j = 0; j < pieces; ++j) {
    const int section = j / per_section;
    const double radius = keep_out.radii[static_cast<std::size_t>(section)];
    const lie::SE3 end = addPiece(X, shape.pieces().col(j), radius, arc, body.spans);
    X = end;
    if (!shape.links() || (j + 1) % per_section != 0) continue;
    X = end * (*shape.links())[section];
    const double length = (X.translation - end.translation).norm();
    if (length > 0 && !(keep_out.tool && j + 1 == pieces)) {
      Span link{end, lie::Vector6::Zero(), end.translation, X.translation, radius, arc, length};
      link.straight = true;
      body.spans.push_back(link);
    }
    arc += length;
  }
  body.X_BT = X;
  const Span& middle = body.spans[body.spans.size() / 2];
  body.centre = middle.begin;
  for (const Span& span : body.spans) {
    const double farthest =
        std::max((span.begin - body.centre).norm(), (span.end - body.centre).norm());
    body.ball = std::max(body.ball, farthest + span.sag + span.radius);
  }
  return body;
}

// A place of a span, with its distance from an obstacle.
struct Seen {
  double t;
  Vector3d place;
  Obstacle::Distance distance;
};

// The search for the place of a body that is nearest to one obstacle.
class Search {
 public:
  /// @param largest  radius of the body [m].
  Search(const Obstacle& obstacle, int zone, double largest, Clearance& best)
      : obstacle_(obstacle), zone_(zone), largest_(largest), best_(best) {}

  // From the tip, which moves most, to the base. Spans that are too far by what was seen before are
  // not looked at: a distance changes no faster than the place.
  void run(const std::vector<Span>& spans) {
    double far_until = std::numeric_limits<double>::infinity();  // length from the base
    for (auto span = spans.rbegin(); span != spans.rend(); ++span) {
      if (span->arc + span->length <= obstacle_.from()) return;
      if (span->arc >= far_until) continue;
      const double first = std::clamp((obstacle_.from() - span->arc) / span->length, 0.0, 1.0);
      const Seen a = look(*span, first, first > 0 ? span->at(first) : span->begin);
      refine(*span, a, look(*span, 1.0, span->end));
      far_until = span->arc - (a.distance.value - largest_ - best_.distance);
    }
  }

 private:
  Seen look(const Span& span, double t, const Vector3d& place) {
    const Obstacle::Distance distance = obstacle_.of(place);
    if (distance.value - span.radius < best_.distance) {
      best_ = {distance.value - span.radius, zone_, place};
    }
    return {t, place, distance};
  }

  // A lower bound of the distance between two places, and where it is reached, as a part of t.
  std::pair<double, double> bound(const Span& span, const Seen& a, const Seen& b) const {
    const double part = b.t - a.t, d_a = a.distance.value, d_b = b.distance.value;
    if (!obstacle_.convex()) {
      return {std::max((d_a + d_b - part * span.length) / 2, 0.0), 0.5};
    }
    const Vector3d chord = b.place - a.place;
    const double slope_a = a.distance.away.dot(chord), slope_b = b.distance.away.dot(chord);
    const double sag = part * part * span.sag;
    if (slope_a >= 0) return {std::max(d_a - sag, 0.0), 0.5};
    if (slope_b <= 0) return {std::max(d_b - sag, 0.0), 0.5};
    const double x = std::clamp((d_b - slope_b - d_a) / (slope_a - slope_b), 0.0, 1.0);
    return {std::max(d_a + slope_a * x - sag, 0.0),
            std::clamp(x, kNearestSplit, 1 - kNearestSplit)};
  }

  void refine(const Span& span, const Seen& a, const Seen& b) {
    const auto [least, split] = bound(span, a, b);
    if (least - span.radius >= best_.distance - kTolerance) return;
    const double t = a.t + split * (b.t - a.t);
    const Seen c = look(span, t, span.at(t));
    const bool first_nearer = a.distance.value < b.distance.value;
    if (first_nearer) refine(span, a, c);
    refine(span, c, b);
    if (!first_nearer) refine(span, a, c);
  }

  const Obstacle& obstacle_;
  const int zone_;
  const double largest_;
  Clearance& best_;
};

// A place of the curve, with what the curve has turned until there.
struct Turned {
  Vector3d place;
  double turn, radius;
};

// The least distance of places with half a turn or more between them.
void lookAtSelf(const std::vector<Span>& spans, int zone, Clearance& best) {
  double turn = 0, length = 0, thinnest = std::numeric_limits<double>::infinity();
  for (const Span& span : spans) {
    turn += span.turn;
    length += span.length;
    thinnest = std::min(thinnest, span.radius);
  }
  if (turn < basics::kPi) return;
  const double step = std::max(thinnest / kStepsPerRadius, length / kMostSteps);
  std::vector<Turned> places;
  turn = 0;
  for (const Span& span : spans) {
    const int count = std::max(1, static_cast<int>(std::ceil(span.length / step)));
    for (int i = 0; i < count; ++i) {
      const double t = static_cast<double>(i) / count;
      places.push_back({span.at(t), turn + t * span.turn, span.radius});
    }
    turn += span.turn;
  }
  places.push_back({spans.back().end, turn, spans.back().radius});
  std::size_t first = 0;  // so far from the place, all before it have turned less
  for (const Turned& one : places) {
    while (first < places.size() && places[first].turn < one.turn + basics::kPi) ++first;
    for (std::size_t j = first; j < places.size(); ++j) {
      const Turned& other = places[j];
      const double distance = (one.place - other.place).norm() - one.radius - other.radius;
      if (distance < best.distance) best = {distance, zone, other.place};
    }
  }
}

// The spans that a tool meets only where the arm bends back to it: a quarter of a turn before the
// tip.
std::vector<Span> spansBehind(const std::vector<Span>& spans) {
  double turn = 0;
  auto end = spans.end();
  while (end != spans.begin() && turn < basics::kPi / 2) turn += (--end)->turn;
  return {spans.begin(), end};
}

}  // namespace

struct ArmClearance::Bodies {
  explicit Bodies(const KeepOut& given) : keep_out(given) {
    basics::requireNotNegative("clearance_m", "the clearance [m]", given.clearance);
    for (const double radius : given.radii) {
      basics::requirePositive("keep_out", "the radius of a section [m]", radius);
    }
    const lie::SE3 X_BW = given.X_WB.inverse();
    for (const Zone& zone : given.zones) {
      obstacles.emplace_back(zone.form, X_BW * zone.X_WZ, zone.from);
    }
    if (!given.tool) return;
    tool = geometryOf(given.tool->form);
    tool->computeLocalAABB();
    half_tool = (tool->aabb_local.max_ - tool->aabb_local.min_) / 2;
  }

  const KeepOut keep_out;
  std::vector<Obstacle> obstacles;
  std::shared_ptr<fcl::CollisionGeometryd> tool;
  Vector3d half_tool = Vector3d::Zero();  // of its bounding box
};

ArmClearance::ArmClearance(const KeepOut& keep_out)
    : bodies_(std::make_shared<const Bodies>(keep_out)) {}

const KeepOut& ArmClearance::keepOut() const { return bodies_->keep_out; }

std::string ArmClearance::nameOf(int zone) const {
  if (zone < 0) return {};
  const auto& zones = keepOut().zones;
  const auto index = static_cast<std::size_t>(zone);
  return index < zones.size() ? zones[index].name : kOwnBody;
}

Clearance ArmClearance::of(const model::Shape& shape) const {
  const KeepOut& keep_out = bodies_->keep_out;
  basics::require(shape.sectionCount() == static_cast<int>(keep_out.radii.size()), "a shape of ",
                  shape.sectionCount(), " sections; expected ", keep_out.radii.size());
  const Body body = bodyOf(shape, keep_out);
  const auto& obstacles = bodies_->obstacles;
  const double largest = *std::max_element(keep_out.radii.begin(), keep_out.radii.end());
  // The nearest first: the others then end early.
  std::vector<std::pair<double, int>> order;
  for (std::size_t i = 0; i < obstacles.size(); ++i) {
    order.emplace_back(obstacles[i].atLeast(body.centre), static_cast<int>(i));
  }
  std::sort(order.begin(), order.end());
  Clearance best;
  for (const auto& [away, zone] : order) {
    if (away - body.ball >= best.distance) continue;
    Search(obstacles[static_cast<std::size_t>(zone)], zone, largest, best).run(body.spans);
  }
  const int own = static_cast<int>(keep_out.zones.size());
  Clearance self;
  lookAtSelf(body.spans, own, self);
  if (bodies_->tool) {
    const lie::SE3 X = body.X_BT * keep_out.tool->X_TB;
    const Eigen::Isometry3d at = isometryOf(X);
    for (const auto& [away, zone] : order) {
      const Obstacle& obstacle = obstacles[static_cast<std::size_t>(zone)];
      if (obstacle.atLeast(at.translation()) - bodies_->tool->aabb_radius >= best.distance)
        continue;
      const double distance = obstacle.of(*bodies_->tool, at);
      if (distance < best.distance) best = {distance, zone, at.translation()};
    }
    const std::vector<Span> behind = spansBehind(body.spans);
    if (!behind.empty()) {
      const Form form = std::visit([](const auto& one) { return Form(one); }, keep_out.tool->form);
      Search(Obstacle(form, X, 0.0), own, largest, self).run(behind);
    }
  }
  if (self.distance < best.distance) best = self;
  best.own = self.distance;
  return best;
}

Eigen::Matrix3Xd ArmClearance::marks(const model::Shape& shape) const {
  const std::optional<ToolBody>& tool = keepOut().tool;
  Eigen::Matrix3Xd marks(3, shape.sectionCount() * kMarks + (tool ? 8 : 1));
  for (int k = 0; k < shape.sectionCount(); ++k) {
    for (int i = 0; i < kMarks; ++i) {
      marks.col(k * kMarks + i) = model::poseAt(shape, k, (i + 1.0) / kMarks).translation;
    }
  }
  const lie::SE3 X_BT = model::tipPose(shape);
  marks.rightCols<1>() = X_BT.translation;
  for (int i = 0; tool && i < 8; ++i) {
    const Vector3d corner(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1);
    marks.col(shape.sectionCount() * kMarks + i) =
        X_BT * (tool->X_TB * corner.cwiseProduct(bodies_->half_tool));
  }
  return marks;
}

}  // namespace helix_arm::clearance
