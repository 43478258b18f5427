#include "fault_hypotheses.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <set>
#include <utility>
#include <variant>

#include "basics/median.hpp"
#include "basics/pi.hpp"
#include "basics/text.hpp"
#include "helix_arm/lie/se3.hpp"

namespace helix_arm::estimation {
namespace {

// ---- Pressures ----

// Muscles of one batch bend as if their pressures differed by some 10 %, and sensors that were
// zeroed once are off by as much as regulators: neither is a mistake.
constexpr double kLeastGain = 0.12, kLeastOffset = 12e3;  // [Pa]

FaultHypothesis exchanged(const Eigen::VectorXi& from, const std::string& subject) {
  return {"channels_exchanged", subject,
          always("exchange the hoses at the regulator, or their channels in the scene"),
          [from](double, Eigen::MatrixXd& read) { read = read(Eigen::all, from).eval(); }};
}

void addExchanges(const model::Arm& arm, std::vector<FaultHypothesis>& out) {
  const int all = arm.actuatorCount();
  const Eigen::VectorXi same = Eigen::VectorXi::LinSpaced(all, 0, all - 1);
  for (int i = 0; i < all; ++i) {
    for (int j = i + 1; j < all; ++j) {
      Eigen::VectorXi from = same;
      std::swap(from[i], from[j]);
      out.push_back(exchanged(from, arm.actuator(i).name + " and " + arm.actuator(j).name));
    }
  }
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const int first = arm.firstActuator(k), next = arm.firstActuator(k + 1), count = next - first;
    for (int turn = 1; turn < count && count > 2; ++turn) {
      Eigen::VectorXi from = same;
      std::vector<std::string> names;
      for (int i = 0; i < count; ++i) {
        from[first + i] = first + (i + turn) % count;
        names.push_back(arm.actuator(from[first + i]).name);
      }
      out.push_back(
          exchanged(from, messageOf("section ", k + 1, ", in the order ", basics::joined(names))));
    }
    if (k + 1 < arm.sectionCount() && arm.firstActuator(k + 2) - next == count && count > 1) {
      Eigen::VectorXi from = same;
      from.segment(first, count).swap(from.segment(next, count));
      out.push_back(exchanged(from, messageOf("sections ", k + 1, " and ", k + 2)));
    }
  }
}

void addUnits(std::vector<FaultHypothesis>& out) {
  // Factors on what was read as kPa; of the last one, as psi.
  static constexpr std::pair<const char*, double> kUnits[] = {{"psi", 6.894757},
                                                              {"bar", 100.0},
                                                              {"mbar", 0.1},
                                                              {"Pa", 1e-3},
                                                              {"kPa instead of psi", 1 / 6.894757}};
  for (const auto& [unit, factor] : kUnits) {
    out.push_back({"pressure_unit", messageOf("all channels in ", unit),
                   always(messageOf("the pressures are in ", unit,
                                    ": convert them, and name their unit in the header")),
                   [factor = factor](double, Eigen::MatrixXd& read) { read *= factor; }});
  }
}

// @param channel  -1: the same gain or offset of all.
void addChannel(const model::Arm& arm, int channel, std::vector<FaultHypothesis>& out) {
  const bool all = channel < 0;
  const int first = std::max(channel, 0), count = all ? arm.actuatorCount() : 1;
  const std::string subject = all ? "all channels" : arm.actuator(channel).name;
  double range = 0;
  for (int i = first; i < first + count; ++i) {
    range = std::max(range, arm.actuator(i).limits.upper - arm.actuator(i).limits.lower);
  }
  const auto scaled = [](double size, const Calibration&) {
    return messageOf(
        "the pressure in the muscle is ", std::round(100 * size),
        " % of what is read: look for a leak, and check the scale of the sensor and of "
        "the regulator");
  };
  out.push_back({"pressure_gain", subject, scaled, [first, count](double size, auto& read) {
                   read.middleCols(first, count) *= size;
                 }});
  // From a muscle that leaks most of its pressure to a regulator of three times the range.
  out.back().size = {{0.35, 0.5, 0.7, 0.9, 1.15, 1.4, 2.0, 2.8}, 1.0, kLeastGain};
  out.back().of_all = all;
  const auto shifted = [range](double part, const Calibration&) {
    return messageOf("the pressure in the muscle is ", std::round(std::abs(part * range) / 1e3),
                     " kPa ", part > 0 ? "above" : "below",
                     " what is read: zero the sensor with the muscle vented");
  };
  out.push_back(
      {"pressure_offset", subject, shifted, [first, count, range](double part, auto& read) {
         read.middleCols(first, count).array() += part * range;
       }});
  out.back().size = {{-0.2, -0.1, -0.05, 0.05, 0.1, 0.2}, 0.0, kLeastOffset / range};
  out.back().of_all = all;
  if (all) return;
  const double vented = std::max(0.0, arm.actuator(channel).limits.lower);
  out.push_back(
      {"channel_dead", subject,
       always("no pressure reaches the muscle: check its hose, its valve and its channel"),
       [channel, vented](double, Eigen::MatrixXd& read) {
         read.col(channel).setConstant(vented);
       }});
}

// ---- Tags and pictures ----

using Poses = std::vector<PoseObservation>;
using CornersSeen = std::vector<CornerObservation>;

// Errors that a ruler leaves in a scene: no smaller one is a mistake [m, rad, fractions]. A single
// picture shows tags that are 1 mm off as tags of another size.
constexpr double kLeastMove = 0.01, kLeastTurn = 0.02, kLeastLength = 0.02;
constexpr double kLeastTagError = 0.03, kLeastTagErrorOfOne = 0.07;
// The farthest that something is turned that was knocked; beyond, it was put up otherwise [rad].
constexpr double kMostTurn = 2.0;
// Deviation of a muscle that was cut to another length, in parts of it.
constexpr double kCutLength = 0.1;

// Visits all tags that an arm's captures show as poses, or as corners.
template <class Observations, class Arm, class Visit>
void forEach(Arm& arm, const Visit& visit) {
  for (auto& capture : arm.captures) {
    if (auto* seen = std::get_if<Observations>(&capture.reading)) {
      for (auto& observation : *seen) visit(observation);
    }
  }
}

// ---- Places and turns of tags ----

// Tags that belong together.
struct TagGroup {
  Eigen::VectorXi tags;  // indices in the layout, in the group's order
  std::string name;
};

TagGroup groupOf(const TagLayout& layout, const std::vector<int>& tags) {
  std::vector<std::string> ids;
  for (const int tag : tags) {
    ids.push_back(std::to_string(layout.tags[static_cast<std::size_t>(tag)].id));
  }
  return {Eigen::Map<const Eigen::VectorXi>(tags.data(), static_cast<Eigen::Index>(tags.size())),
          (ids.size() == 1 ? "tag " : "tags ") + basics::joined(ids)};
}

// The tags in an order, divided: each joins the first group whose last tag it follows.
template <class Before, class Follows>
std::vector<TagGroup> groupsOf(const TagLayout& layout, const Before& before,
                               const Follows& follows) {
  const auto at = [&layout](int tag) -> const TagPlacement& {
    return layout.tags[static_cast<std::size_t>(tag)];
  };
  std::vector<int> order(layout.tags.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return before(at(a), at(b)); });
  std::vector<std::vector<int>> groups;
  for (const int tag : order) {
    const auto group = std::find_if(groups.begin(), groups.end(), [&](const auto& tags) {
      return follows(at(tags.back()), at(tag));
    });
    if (group == groups.end()) {
      groups.push_back({tag});
    } else {
      group->push_back(tag);
    }
  }
  std::vector<TagGroup> out;
  for (const std::vector<int>& tags : groups) out.push_back(groupOf(layout, tags));
  return out;
}

// Tags at one place along the arm, by their angle about it; from the base to the tip.
std::vector<TagGroup> rowsOf(const TagLayout& layout) {
  const auto place = [](const TagPlacement& tag) {
    constexpr double kSamePlace = 0.01;  // of a section
    return std::lround((tag.section + tag.s) / kSamePlace);
  };
  const auto key = [&place](const TagPlacement& tag) {
    const Eigen::Vector3d& at = tag.X_ST.translation;
    return std::pair(place(tag), std::atan2(at.z(), at.y()));
  };
  return groupsOf(
      layout, [&](const auto& a, const auto& b) { return key(a) < key(b); },
      [&](const auto& last, const auto& next) { return place(last) == place(next); });
}

// Tags along each section, as along a muscle: each follows the one before at nearly its angle about
// the arm.
std::vector<TagGroup> stripsOf(const TagLayout& layout) {
  constexpr double kSameStrip = 0.9;  // cosine of the angle from one tag to the next
  return groupsOf(
      layout, [](const auto& a, const auto& b) { return a.s < b.s; },
      [](const TagPlacement& last, const TagPlacement& next) {
        const Eigen::Vector2d a = last.X_ST.translation.tail<2>(),
                              b = next.X_ST.translation.tail<2>();
        return last.section == next.section && last.s < next.s &&
               a.dot(b) > kSameStrip * a.norm() * b.norm();
      });
}

// The tags that are where the scene has tags 0, 1, ..; and the quarter turns of each place.
struct Places {
  explicit Places(const TagLayout& layout)
      : tag(Eigen::VectorXi::LinSpaced(static_cast<Eigen::Index>(layout.tags.size()), 0,
                                       static_cast<int>(layout.tags.size()) - 1)),
        quarters(0 * tag) {}

  void exchange(const TagGroup& a, const TagGroup& b) {
    tag(a.tags) = b.tags;
    tag(b.tags) = a.tags;
  }

  Eigen::VectorXi tag, quarters;
};

// About the normal of a tag, counterclockwise as one reads it.
void turnTag(int quarters, Eigen::Matrix3d& rotation) {
  if (quarters == 0) return;
  rotation *=
      Eigen::AngleAxisd(0.5 * basics::kPi * quarters, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

FaultHypothesis tagHypothesis(const std::string& cause, const std::string& subject,
                              const Places& places, const std::string& remedy) {
  FaultHypothesis out{cause, subject, always(remedy)};
  out.correct_captures = [places](double, CalibrationInput& input) {
    forEach<Poses>(input.arms.front(), [&](PoseObservation& seen) {
      turnTag(-places.quarters[seen.tag], seen.X_BT.rotation);
      seen.tag = places.tag[seen.tag];
    });
    forEach<CornersSeen>(input.arms.front(), [&](CornerObservation& seen) {
      const Corners read = seen.direction;
      const int first = 4 - places.quarters[seen.tag];
      for (int i = 0; i < 4; ++i) seen.direction.col(i) = read.col((i + first) % 4);
      seen.tag = places.tag[seen.tag];
    });
  };
  out.correct_tags = [places](double, TagLayout& layout) {
    const std::vector<TagPlacement> before = layout.tags;
    for (std::size_t i = 0; i < before.size(); ++i) {
      const auto here = static_cast<Eigen::Index>(i);
      layout.tags[i] = before[static_cast<std::size_t>(places.tag[here])];
      layout.tags[i].id = before[i].id;
      turnTag(places.quarters[here], layout.tags[i].X_ST.rotation);
    }
  };
  return out;
}

void addTurns(const TagGroup& group, const TagLayout& layout, std::vector<FaultHypothesis>& out) {
  for (int quarters = 1; quarters < 4; ++quarters) {
    Places places(layout);
    places.quarters(group.tags).setConstant(quarters);
    out.push_back(tagHypothesis(
        "tags_turned", group.name, places,
        messageOf("they are glued turned by ", 90 * quarters,
                  " degrees counterclockwise: turn them in the scene's tags, or on the "
                  "arm")));
  }
}

// ---- Pictures ----

// As pictures show the corners that were read on pictures of another size, or turned by 180
// degrees.
void changePixels(ArmCaptures& arm,
                  const std::function<Eigen::Vector2d(const Eigen::Vector2d&)>& change) {
  const Camera& camera = arm.camera;
  forEach<CornersSeen>(arm, [&](CornerObservation& seen) {
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector2d pixel = change(camera.pixelOf(seen.direction.col(i)));
      // Where the distortion cannot be inverted, the picture shows nothing.
      seen.direction.col(i) = camera.directionOf(pixel).value_or(seen.direction.col(i));
    }
  });
}

void addOrders(const TagLayout& layout, std::vector<FaultHypothesis>& out) {
  const std::vector<TagGroup> rows = rowsOf(layout);
  for (std::size_t a = 0; a < rows.size(); ++a) {
    for (std::size_t b = a + 1; b < rows.size(); ++b) {
      if (rows[a].tags.size() != rows[b].tags.size()) continue;
      Places places(layout);
      places.exchange(rows[a], rows[b]);
      out.push_back(tagHypothesis("tag_rows_exchanged", rows[a].name + " and " + rows[b].name,
                                  places, "exchange them in the scene's tags, or on the arm"));
    }
  }
  Places reversed(layout), mirrored(layout);
  bool reversible = rows.size() > 2, mirrors = false;
  for (std::size_t a = 0; a < rows.size(); ++a) {
    const TagGroup& row = rows[a];
    const TagGroup& other = rows[rows.size() - 1 - a];
    reversible = reversible && row.tags.size() == other.tags.size();
    if (reversible) reversed.exchange(row, other);
    mirrors = mirrors || row.tags.size() > 2;
    mirrored.tag(row.tags) = row.tags.reverse();
  }
  if (reversible) {
    out.push_back(
        tagHypothesis("tag_rows_reversed", "all tags", reversed,
                      "the rows are counted from the tip: number them from the base in the scene"));
  }
  if (mirrors) {
    out.push_back(tagHypothesis(
        "tags_mirrored", "all tags", mirrored,
        "the tags of each row are in the other order around the arm: turn it in the scene"));
  }
}

void addTurns(const ArmCaptures& arm, std::vector<FaultHypothesis>& out) {
  const TagLayout& layout = arm.layout;
  std::vector<TagGroup> groups = rowsOf(layout);
  if (groups.size() > 1) groups.push_back({Places(layout).tag, "all tags"});
  for (TagGroup& strip : stripsOf(layout)) {
    const bool some = static_cast<std::size_t>(strip.tags.size()) < layout.tags.size();
    if (strip.tags.size() > 1 && some) groups.push_back(std::move(strip));
  }
  // Row and strip of the only tag that is seen of them are the same hypothesis, of this tag.
  std::set<int> seen;
  const auto add = [&seen](const auto& observation) { seen.insert(observation.tag); };
  forEach<Poses>(arm, add);
  forEach<CornersSeen>(arm, add);
  std::set<std::string> names;
  for (TagGroup& group : groups) {
    std::vector<int> shown;
    std::copy_if(group.tags.begin(), group.tags.end(), std::back_inserter(shown),
                 [&seen](int tag) { return seen.count(tag) > 0; });
    if (shown.size() == 1) group = groupOf(layout, shown);
    if (!shown.empty() && names.insert(group.name).second) addTurns(group, layout, out);
  }
}

void addPictures(const ArmCaptures& arm, std::vector<FaultHypothesis>& out) {
  const int width = arm.camera.width;
  for (const int side : {320, 640, 800, 1024, 1280, 1600, 1920, 2560, 3840}) {
    if (side == width) continue;
    FaultHypothesis scaled{
        "picture_size", "the camera",
        always(messageOf("the pictures are ", side,
                         " pixels wide, those that the camera was calibrated at ", width,
                         ": take them at that size, or calibrate the camera at this one"))};
    const double factor = static_cast<double>(width) / side;
    scaled.correct_captures = [factor](double, CalibrationInput& input) {
      // Pixel (0, 0) is the centre of the first one.
      const Eigen::Vector2d half(0.5, 0.5);
      changePixels(input.arms.front(), [&](const Eigen::Vector2d& pixel) {
        return Eigen::Vector2d(factor * (pixel + half) - half);
      });
      // The noise is of the picture as it is.
      input.options.corner_noise *= factor;
      input.options.corner_floor *= factor;
    };
    out.push_back(std::move(scaled));
  }
  FaultHypothesis turned{"picture_turned", "the camera",
                         always("the pictures are upside down: turn the camera, or its pictures")};
  const Eigen::Vector2d last(width - 1, arm.camera.height - 1);
  turned.correct_captures = [last](double, CalibrationInput& input) {
    changePixels(input.arms.front(),
                 [&](const Eigen::Vector2d& pixel) { return Eigen::Vector2d(last - pixel); });
  };
  out.push_back(std::move(turned));
  FaultHypothesis size{
      "tag_size", "all tags", [](double, const Calibration& fit) {
        return messageOf(
            "write tags.size_m: ", std::round(1e5 * fit.layout.size) / 1e5,
            " into the scene, measured over the outer edge of the black border (of "
            "families Circle, Custom and Standard over its inner edge, around the white "
            "square)");
      }};
  size.correct_tags = [](double factor, TagLayout& layout) { layout.size *= factor; };
  size.correct_scene = [](double factor, CalibrationInput& input) {
    input.arms.front().layout.size *= factor;
  };
  const double least = arm.captures.size() == 1 ? kLeastTagErrorOfOne : kLeastTagError;
  size.size = {{0.6, 0.8, 1.25, 1.6}, 1.0, least};
  out.push_back(std::move(size));
}

// ---- Base or camera, muscles, load ----

double usualOf(const Eigen::VectorXd& scales) {
  return basics::medianOf(std::vector<double>(scales.begin(), scales.end()));
}

// @param subject  "base" or "camera".
FaultHypothesis moveOf(const std::string& subject) {
  const auto remedy = [](double, const Calibration& fit) -> std::optional<std::string> {
    const double move = fit.X_B0B.translation.norm(), turn = turnOf(fit.X_B0B);
    if (turn >= kMostTurn || (turn <= kLeastTurn && move <= kLeastMove)) return std::nullopt;
    return messageOf("it is ", std::round(1e3 * move), " mm and ",
                     std::round(turn * 1800 / basics::kPi) / 10,
                     " degrees from where the scene has it: fit base as well");
  };
  FaultHypothesis out{subject + "_moved", "the " + subject, remedy};
  out.correct_scene = [](double, CalibrationInput& input) {
    input.options.fit.insert(FitParameter::kBase);
    input.options.base_prior = kMovedBase;
  };
  out.freed = 6;
  return out;
}

FaultHypothesis lengthsOf(const model::Arm& arm) {
  const auto remedy = [arm](double, const Calibration& fit) -> std::optional<std::string> {
    const Eigen::VectorXd& scale = fit.length_scale;
    if (std::abs(scale[oddMuscle(scale)] - usualOf(scale)) <= kLeastLength) return std::nullopt;
    std::vector<std::string> parts;
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      parts.push_back(messageOf(arm.actuator(i).name, " ", std::round(1e3 * scale[i]) / 10, " %"));
    }
    return messageOf("the muscles are ", basics::joined(parts),
                     " of the length in the scene: fit length_scale_each as well");
  };
  FaultHypothesis out{"muscle_length", "", remedy};
  out.correct_scene = [](double, CalibrationInput& input) {
    input.options.fit.insert(FitParameter::kLengthScaleEach);
    input.options.length_scale_prior = kCutLength;
  };
  out.freed = arm.actuatorCount();
  return out;
}

void addLoads(std::vector<FaultHypothesis>& out) {
  const auto add = [&out](double factor, const char* remedy) {
    out.push_back({"load", "gravity", always(remedy)});
    out.back().correct_scene = [factor](double, CalibrationInput& input) {
      input.arms.front().load->gravity *= factor;
    };
  };
  add(-1, "it points the other way: turn load.gravity or the base in the scene");
  add(0, "the arm hangs from nothing: leave its weight out of the scene's load");
}

}  // namespace

std::vector<FaultHypothesis> pressureHypotheses(const model::Arm& arm) {
  std::vector<FaultHypothesis> out;
  addExchanges(arm, out);
  addUnits(out);
  for (int channel = -1; channel < arm.actuatorCount(); ++channel) addChannel(arm, channel, out);
  return out;
}

double turnOf(const lie::SE3& pose) { return pose.log().tail<3>().norm(); }

int oddMuscle(const Eigen::VectorXd& scales) {
  int odd = 0;
  (scales.array() - usualOf(scales)).abs().maxCoeff(&odd);
  return odd;
}

std::vector<FaultHypothesis> turnHypotheses(int tag, const TagLayout& layout) {
  std::vector<FaultHypothesis> out;
  addTurns(groupOf(layout, {tag}), layout, out);
  return out;
}

std::vector<FaultHypothesis> rigHypotheses(const ArmCaptures& arm,
                                           const CalibrationOptions& options, ReadingKind kind) {
  std::vector<FaultHypothesis> out;
  const bool corners = kind == ReadingKind::kCorners, tags = isMet(FitNeed::kTags, kind);
  if (tags) addOrders(arm.layout, out);
  // Positions alone do not show how a tag is turned.
  if (corners || (tags && options.rotation_noise > 0)) addTurns(arm, out);
  if (corners) addPictures(arm, out);
  if (tags && !options.fits(FitParameter::kBase))
    out.push_back(moveOf(corners ? "camera" : "base"));
  // Shapes that are free follow any lengths and loads.
  if (options.free_shapes) return out;
  if (!options.fits(FitParameter::kLengthScaleEach) && !options.fits(FitParameter::kContraction)) {
    out.push_back(lengthsOf(arm.arm));
  }
  if (arm.isLoaded()) addLoads(out);
  return out;
}

}  // namespace helix_arm::estimation
