#include "marker_parts.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "conversions.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kSigmas = 2.0;
constexpr double kThinnest = 1e-4;  // rviz does not draw what has no extent [m]

constexpr double kUsualLength = 0.3;  // of an arm, for which all lengths here are given [m]
constexpr double kUpright = 0.85;     // |cosine| of the angle to the vertical of an upright arm
constexpr double kSideways = 0.2;     // horizontal part of a direction that has a side to look from
constexpr double kUsualYaw = 0.3;     // of an upright arm: from any side, and not straight on
constexpr double kUsualPitch = 0.15;  // slightly from above: the ground shows depth
constexpr double kBeside = 0.08;      // from the discs to the columns [m]
constexpr double kAbove = 0.04;       // from the discs to columns above them [m]
constexpr double kBetween = 0.17;     // from the middle of the arm to columns above it [m]
constexpr double kHalfColumn = 0.12;  // half the width of a column [m]
constexpr double kColumn = 0.17;      // height of the legend [m]
constexpr double kBanner = 0.16;      // height of state and reason [m]
constexpr double kTipTexts = 0.2;     // beyond the tip [m]
constexpr double kTipTable = 0.34;    // from the tip to the end of the loop's table [m]
constexpr double kLegendHeight = 0.016;  // of its letters [m]

struct LegendText {
  const char* text;
  double r, g, b;
};
constexpr std::array<LegendText, kLegendLineCount> kLegend = {
    {{"white: model", 1.0, 1.0, 1.0},
     {"green: tip trace", 0.4, 1.0, 0.6},
     {"orange: measured", 1.0, 0.55, 0.1},
     {"yellow: model at the picture", 1.0, 0.95, 0.4},
     {"cyan line: predicted", 0.2, 0.9, 1.0},
     {"magenta: wanted tip", 1.0, 0.3, 0.9}}};

}  // namespace

std_msgs::ColorRGBA color(double r, double g, double b, double a) {
  std_msgs::ColorRGBA out;
  out.r = static_cast<float>(r);
  out.g = static_cast<float>(g);
  out.b = static_cast<float>(b);
  out.a = static_cast<float>(a);
  return out;
}

visualization_msgs::Marker MarkerFrame::operator()(const ros::Time& stamp, const char* ns, int type,
                                                   int id) const {
  visualization_msgs::Marker out;
  out.header = toHeaderMsg(stamp, frame);
  out.ns = ns;
  out.id = id;
  out.type = type;
  out.action = visualization_msgs::Marker::ADD;
  out.pose.orientation.w = 1.0;
  out.lifetime = lifetime;
  return out;
}

void shapeLike(const Eigen::Matrix3d& covariance, const Eigen::Vector3d& centre,
               visualization_msgs::Marker& sphere) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  Eigen::Matrix3d axes = solver.eigenvectors();
  if (axes.determinant() < 0) axes.col(0) *= -1.0;  // right-handed
  sphere.pose = toPoseMsg({axes, centre});
  const auto diameter = [&](int axis) {
    const double sigma = std::sqrt(std::max(0.0, solver.eigenvalues()[axis]));
    return std::max(kThinnest, 2.0 * kSigmas * sigma);
  };
  sphere.scale.x = diameter(0);
  sphere.scale.y = diameter(1);
  sphere.scale.z = diameter(2);
}

double SideView::distance(double field_of_view, double aspect) const {
  const double half = std::tan(0.5 * field_of_view);
  // What is nearer to the camera than the base is larger.
  constexpr double kMargin = 1.05;
  return kMargin * 0.5 * std::max(height / half, width / (half * aspect));
}

SideView sideView(const Eigen::Vector3d& axis, double length, double radius) {
  const Eigen::Vector3d along = axis.normalized();
  const double unit = length / kUsualLength, rise = along.z() * length;
  SideView out;
  out.scale = unit;
  out.pitch = kUsualPitch;
  out.up = Eigen::Vector3d::UnitZ();
  const bool upright = std::abs(along.z()) > kUpright, stands = upright && along.z() > 0;
  out.yaw =
      std::hypot(along.x(), along.y()) < kSideways ? kUsualYaw : std::atan2(-along.x(), along.y());
  out.right = Eigen::Vector3d(-std::sin(out.yaw), std::cos(out.yaw), 0);
  out.beyond = stands ? out.up : Eigen::Vector3d(-out.up);

  double top = 0, bottom = 0, left = 0, to_right = 0, column = 0, middle = 0, headline = 0;
  if (upright) {
    column = kBeside * unit + 3.0 * radius;
    // Away from the arm: above the base of one that hangs, below that of one that stands.
    headline = (stands ? -0.04 : kBanner - 0.025) * unit;
    top = stands ? rise + kTipTexts * unit : kBanner * unit;
    bottom = stands ? -kBanner * unit : rise - kTipTexts * unit;
    left = -column - kHalfColumn * unit;
    to_right = std::max(column + kHalfColumn * unit, kTipTable * unit);
  } else {
    const double reach = std::hypot(along.x(), along.y()) * length;
    middle = 0.5 * reach;
    column = kBetween * unit;
    const double base = std::max(0.0, rise) + 2.0 * radius;
    headline = base + (kAbove + kColumn + kBanner) * unit;
    top = headline + 0.03 * unit;
    bottom = std::min(0.0, rise) - kTipTexts * unit;
    left = std::min(-2.0 * radius, middle - column - kHalfColumn * unit);
    to_right = reach + kTipTable * unit;
  }
  const double first =
      upright ? (stands ? kColumn * unit : 0.0) : headline - (kBanner - 0.01) * unit;
  const auto at = [&](double x, double y) -> Eigen::Vector3d { return x * out.right + y * out.up; };
  out.headline = at(middle, headline);
  out.legend_top = at(middle - column, first);
  out.table_top = at(middle + column, first);
  out.centre = at(0.5 * (left + to_right), 0.5 * (top + bottom));
  out.width = to_right - left;
  out.height = top - bottom;
  return out;
}

SideView seenFrom(const Eigen::Matrix3d& R_WB, SideView view) {
  for (Eigen::Vector3d* vector : {&view.right, &view.up, &view.beyond, &view.headline,
                                  &view.legend_top, &view.table_top, &view.centre}) {
    *vector = R_WB.transpose() * *vector;
  }
  return view;
}

SideView sideViewOf(const io::Scene& scene) {
  const Eigen::Matrix3d& R_WB = scene.X_WB.rotation;
  return seenFrom(
      R_WB, sideView(R_WB.col(0), scene.arm.restLength(), scene.looks.front().separator_radius));
}

Eigen::Vector3d centreOfLines(const SideView& view, const Eigen::Vector3d& top, int n,
                              double height) {
  return top - 0.5 * (n - 1) * kLineSpacing * height * view.up;
}

std::string lineOfColumn(int i, int n, const std::string& text) {
  return std::string(static_cast<std::size_t>(i), '\n') + text +
         std::string(static_cast<std::size_t>(n - 1 - i), '\n');
}

visualization_msgs::Marker legendLine(LegendLine line, const SideView& view,
                                      visualization_msgs::Marker marker) {
  const auto row = static_cast<std::size_t>(line);
  const LegendText& entry = kLegend[row];
  const double height = kLegendHeight * view.scale;
  const Eigen::Vector3d place = centreOfLines(view, view.legend_top, kLegendLineCount, height);
  marker.id = static_cast<int>(row);
  marker.scale.z = height;
  marker.color = color(entry.r, entry.g, entry.b);
  marker.text = lineOfColumn(marker.id, kLegendLineCount, entry.text);
  marker.pose.position = toPointMsg(place);
  return marker;
}

}  // namespace helix_arm::ros_bridge
