#include <iostream>

#include "basics/text.hpp"
#include "command.hpp"
#include "helix_arm/control/tip_path.hpp"
#include "io/data/tip_path_file.hpp"
#include "io/document/atomic_file.hpp"

namespace helix_arm::cli {
namespace {

using control::PathPlane;
using control::ShapedPath;
using control::TipWayPoint;

constexpr model::Range kRadius{1e-6, 1e6};
constexpr model::Range kPathPeriod{1e-3, control::kLongestPath};

struct PathArguments {
  std::string shape, centre, plane = nameOf(PathPlane::kYz), out;
  ShapedPath path;
};

// Names of all shapes or planes, for the help.
template <std::size_t kCount, class Named>
std::vector<std::string> namesOf(const Named (&all)[kCount]) {
  std::vector<std::string> names;
  for (const Named named : all) names.emplace_back(nameOf(named));
  return names;
}

// The entry with a name that the option has already validated.
template <std::size_t kCount, class Named>
Named withName(const std::string& name, const Named (&all)[kCount]) {
  for (const Named named : all) {
    if (name == nameOf(named)) return named;
  }
  throw CallerError(name + " is not the name of a shape or a plane");
}

ShapedPath pathOf(const PathArguments& arguments) {
  ShapedPath path = arguments.path;
  path.shape = withName(arguments.shape, control::kTipShapes);
  path.centre = numberList("--centre", arguments.centre, 3);
  path.plane = withName(arguments.plane, control::kPathPlanes);
  return path;
}

// "[1.000000, 2.000000]"
std::string bracketed(const Eigen::VectorXd& vector) {
  std::vector<std::string> parts;
  for (const double each : vector) parts.push_back(basics::format("%.6f", each));
  return "[" + basics::joined(parts) + "]";
}

// "circle of radius 0.02 m around [..] m in the plane yz, 1 turn of 20 s"
std::string describe(const ShapedPath& path) {
  return basics::format("%s of radius %g m around %s m in the plane %s, %d turn%s of %g s",
                        nameOf(path.shape), path.radius, bracketed(path.centre).c_str(),
                        nameOf(path.plane), path.turns, path.turns == 1 ? "" : "s", path.period);
}

std::string csvOf(const ShapedPath& path, const std::vector<TipWayPoint>& points) {
  return io::tipPathCsv(points, "Path of the tip, seen from the arm's base: " + describe(path));
}

json reportOf(const ShapedPath& path, const std::vector<TipWayPoint>& points,
              const std::string& out) {
  json result{{"shape", nameOf(path.shape)}, {"centre_m", path.centre},
              {"radius_m", path.radius},     {"period_s", path.period},
              {"turns", path.turns},         {"plane", nameOf(path.plane)},
              {"points", points.size()},     {"duration_s", points.back().time},
              {"out", textOrNull(out)},      {"time_s", nullptr},
              {"position_m", nullptr}};
  if (!out.empty()) return result;
  for (const TipWayPoint& point : points) {
    result["time_s"].push_back(point.time);
    result["position_m"].push_back(point.position);
  }
  return result;
}

int run(const PathArguments& arguments, const GlobalOptions& global) {
  refuseIf(!global.overrides.empty(),
           "path reads no scene that --set could change; leave out --set");
  const ShapedPath path = pathOf(arguments);
  const std::vector<TipWayPoint> points = control::wayPointsOf(path);
  const std::string& out = arguments.out;
  if (!out.empty()) io::writeFileAtomically(out, csvOf(path, points));
  if (out.empty() && global.format != Format::kJson) {
    std::cout << csvOf(path, points);
    return kDone;
  }
  const json report = reportOf(path, points, out);
  json shown = report;
  shown["begin_m"] = points.front().position;
  printResult(global.format, report, shown, Csv{{"shape", "points", "duration_s", "out"}});
  return kDone;
}

}  // namespace

void addPath(Commands& commands) {
  auto [command, arguments] = commands.add<PathArguments>(
      "path", "write a path of the tip: a circle, a square or a lemniscate", run);
  addOption(command, "SHAPE", arguments.shape, "circle, square or lemniscate", kRequired,
            CLI::IsMember(namesOf(control::kTipShapes)));
  addOption(command, "--centre", arguments.centre, "centre, seen from the arm's base [m]: x,y,z",
            kRequired);
  addOption(command, "--radius", arguments.path.radius,
            "largest distance from the centre along each axis of the plane [m]; the sides of a "
            "square have twice this length",
            kRequired, TypeName{"M"}, within(kRadius));
  addOption(command, "--period", arguments.path.period, "time of one turn [s]", kRequired,
            TypeName{"S"}, within(kPathPeriod));
  addOption(command, "--turns", arguments.path.turns, "number of turns",
            CLI::Range(1, control::kMostTurns), kShowDefault);
  addOption(command, "--plane", arguments.plane,
            "plane of the shape, by two axes of the base: xy, xz or yz",
            CLI::IsMember(namesOf(control::kPathPlanes)), kShowDefault);
  addOption(command, "--out", arguments.out, "path file to write; default: stdout",
            TypeName{"FILE"});
  command.footer(
      R"(A path file has the columns time_s, x_m, y_m, z_m (seen from the arm's base), 200 rows a
turn. A cubic spline at rest at both ends joins them. Shapes run from the plane's first
axis to its second. Circle and lemniscate begin at the centre + radius along the first
axis and have a constant speed. The square begins at the corner centre + radius along
both and rests at each corner: its speed rises and falls for a fifth of a side's time.
json: shape, centre_m, radius_m, period_s, turns, plane, points (number), duration_s,
out (null if absent), time_s and position_m (of all points; null with --out).
text, csv: the path file; with --out a summary.)");
}

}  // namespace helix_arm::cli
