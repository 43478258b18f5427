#include "helix_arm/simulation/camera.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <string>

#include <opencv2/imgproc.hpp>

#include "backdrop.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"
#include "tag_pattern.hpp"

namespace helix_arm::simulation {
namespace {

using estimation::ArmView;
using Areas = TagPattern::Areas;

const char* const kCulprit = "simulated camera";

// Gray levels of paper and ink in full light.
constexpr double kWhite = 222, kBlack = 34;
// A face turned away from the camera, where the light is, still gets this much of it.
constexpr double kAmbientLight = 0.65;
constexpr double kLeastCosine = 0.02;  // of a face that is drawn at all

// The arm is drawn as bands from rim to middle, the light from the left.
struct Band {
  double left, right;  // in half widths
  double gray;
};
constexpr std::array<Band, 5> kBands = {
    {{-1.0, 1.0, 62}, {-0.88, 0.82, 84}, {-0.72, 0.55, 104}, {-0.55, 0.2, 122}, {-0.4, -0.1, 136}}};
constexpr double kRingGray = 0.9;  // every other piece of the arm, as if it had rings
constexpr int kPiecesPerSection = 32;
constexpr double kFarOff = 2e4;  // no pixel is drawn beyond [px]

constexpr int kNoiseTable = 1 << 16;
constexpr double kBlurReach = 3.5;      // standard deviations
constexpr double kMostCells = 1e3;      // from a tag's corner to a pixel that may show it
constexpr int kOutlinePoints = 8;       // a side of a tag, as distortion bends it
constexpr double kOutlineMargin = 2.0;  // that these may miss [px]

constexpr double kWander = 0.4;  // of an occluder from the middle, in pictures

// A bar that wanders, all in fractions of the picture and radians a picture.
struct Occluder {
  double x_rate, x_phase, y_rate, y_phase, turn_rate, turn_phase, half_width, half_length, gray;
};

struct ArmNode {
  bool seen = false;
  cv::Point2d pixel;
  double half_width = 0;  // [px]
  double depth = 0;       // [m]
};

// Something to draw, farthest first.
struct Layer {
  double depth;  // [m]
  int tag;       // -1: a piece of the arm
  int piece;
};

// Where a corner of a pixel looks through a tag's plane.
struct PlanePoint {
  bool valid = false;
  TagPattern::Point point{};
};

}  // namespace

void SimulatedCameraConfig::validate() const {
  const char* const not_negative = "a finite value >= 0";
  basics::requireValue(std::isfinite(blur) && blur >= 0, kCulprit, "the blur [px]", blur,
                       not_negative);
  basics::requireValue(std::isfinite(noise) && noise >= 0, kCulprit, "the noise [gray levels]",
                       noise, not_negative);
  basics::requireValue(std::isfinite(exposure) && exposure > 0, kCulprit, "the exposure", exposure,
                       "a finite value > 0");
  basics::requireValue(std::isfinite(bleed) && bleed >= 0, kCulprit, "the bleed [m]", bleed,
                       not_negative);
  basics::requireValue(jpeg_quality >= 1 && jpeg_quality <= 100, kCulprit, "the JPEG quality",
                       jpeg_quality, "1 to 100");
  basics::requireValue(clutter >= 0, kCulprit, "the number of objects in the background", clutter,
                       "a value >= 0");
  basics::requireValue(occluders >= 0, kCulprit, "the number of occluders", occluders,
                       "a value >= 0");
}

struct SimulatedCamera::Workspace {
  Workspace(const ArmView& view_in, const vision::TagFamily& family, const ArmBody& body_in,
            const SimulatedCameraConfig& config_in);

  const cv::Mat& render(const model::Shape& shape);

  void collectLayers(const model::Shape& shape);
  void drawPiece(int piece);
  void drawTag(int tag);
  cv::Rect boxOf(const lie::SE3& X_CT) const;
  void lookThrough(int y, const cv::Rect& box, const Eigen::Matrix3d& cells_of_direction,
                   const TagPattern& pattern, std::vector<PlanePoint>& out) const;
  void drawOccluders();
  void develop();

  ArmView view;
  ArmBody body;
  SimulatedCameraConfig config;
  double cell;   // side of a tag's cell [m]
  double cells;  // across a card
  std::vector<TagPattern> patterns;
  std::vector<Occluder> occluders;
  cv::Mat directions;  // (CV_32FC2) (x/z, y/z) seen at the corners of the pixels
  cv::Mat backdrop, sharp, blurred, picture;
  std::vector<float> noise;  // what develop() adds before it cuts the fraction off
  std::mt19937 generator;
  int picture_number = 0;

  // Of the picture in work.
  std::vector<lie::SE3> tag_poses;  // X_CT
  std::vector<ArmNode> nodes;
  std::vector<Layer> layers;
  std::vector<PlanePoint> above, below;
  std::vector<Areas> lines_above, lines_below;
};

namespace {

cv::Mat directionsAtPixelCorners(const estimation::Camera& camera) {
  cv::Mat out(camera.height + 1, camera.width + 1, CV_32FC2);
  const float unseen = std::numeric_limits<float>::quiet_NaN();
  for (int y = 0; y < out.rows; ++y) {
    auto* row = out.ptr<cv::Vec2f>(y);
    for (int x = 0; x < out.cols; ++x) {
      const auto direction = camera.directionOf({x - 0.5, y - 0.5});
      row[x] = direction ? cv::Vec2f(static_cast<float>(direction->x()),
                                     static_cast<float>(direction->y()))
                         : cv::Vec2f(unseen, unseen);
    }
  }
  return out;
}

// Includes the half that turns cutting into rounding.
std::vector<float> noiseTable(double deviation, std::uint32_t seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  std::vector<float> table(kNoiseTable);
  for (float& value : table) value = static_cast<float>(0.5 + deviation * normal(generator));
  return table;
}

std::vector<Occluder> makeOccluders(int count, std::mt19937& generator) {
  std::vector<Occluder> out(count);
  const auto rate = [&generator] {
    const double speed = uniform(generator, 0.015, 0.05);
    return uniform(generator, -1, 1) < 0 ? -speed : speed;
  };
  const auto phase = [&generator] { return uniform(generator, 0, 2 * CV_PI); };
  for (Occluder& bar : out) {
    bar.x_rate = rate();
    bar.x_phase = phase();
    bar.y_rate = rate();
    bar.y_phase = phase();
    bar.turn_rate = rate();
    bar.turn_phase = phase();
    bar.half_width = uniform(generator, 0.02, 0.04);
    bar.half_length = uniform(generator, 0.2, 0.4);
    bar.gray = uniform(generator, 50, 120);
  }
  return out;
}

// The mean of the card over a pixel is painted where the pixel shows nothing but card, and mixed in
// where it shows less.
void paintPixel(const Areas& areas, double light, uchar& pixel) {
  if (areas.whole == 0) return;
  const double card = std::clamp(areas.card / areas.whole, 0.0, 1.0);
  const double white = std::clamp(areas.white / areas.whole, 0.0, card);
  const double gray = light * (kWhite * white + kBlack * (card - white)) + (1 - card) * pixel;
  pixel = static_cast<uchar>(gray + 0.5);
}

}  // namespace

SimulatedCamera::Workspace::Workspace(const ArmView& view_in, const vision::TagFamily& family,
                                      const ArmBody& body_in,
                                      const SimulatedCameraConfig& config_in)
    : view(view_in), body(body_in), config(config_in), generator(config_in.seed) {
  view.validate();
  config.validate();
  basics::requireValue(std::isfinite(body.radius) && body.radius > 0, kCulprit,
                       "the arm's radius [m]", body.radius, "a finite value > 0");
  cell = view.layout.size / family.borderCells();
  cells = family.borderCells() + 2 * family.quietCells();
  basics::requireValue(config.bleed < 0.5 * cell, kCulprit, "the bleed [m]", config.bleed,
                       "less than half a cell of the tags");
  for (const estimation::TagPlacement& tag : view.layout.tags) {
    basics::requireValue(tag.id < family.count(), kCulprit, "the id of a tag", tag.id,
                         "one that the family of the tags has");
    patterns.emplace_back(family.cells(tag.id), config.bleed / cell);
  }
  occluders = makeOccluders(config.occluders, generator);
  const estimation::Camera& camera = view.camera;
  directions = directionsAtPixelCorners(camera);
  backdrop = paintBackdrop(camera.width, camera.height, config.clutter, config.seed);
  noise = noiseTable(config.noise, config.seed);
  noise.resize(kNoiseTable + camera.width);  // a row may begin anywhere in the table
  for (int x = 0; x < camera.width; ++x) noise[kNoiseTable + x] = noise[x % kNoiseTable];
  picture.create(camera.height, camera.width, CV_8UC1);
}

const cv::Mat& SimulatedCamera::Workspace::render(const model::Shape& shape) {
  basics::requireValue(shape.sectionCount() == view.sections, kCulprit, "the number of sections",
                       shape.sectionCount(), "one a section of the arm in view");
  basics::requireValue(shape.pieces().allFinite(), kCulprit, "a twist", "not finite",
                       "finite twists");
  backdrop.copyTo(sharp);
  collectLayers(shape);
  for (const Layer& layer : layers) {
    if (layer.tag < 0) {
      drawPiece(layer.piece);
    } else {
      drawTag(layer.tag);
    }
  }
  drawOccluders();
  if (config.blur > 0) {
    const int reach = std::max(1, static_cast<int>(std::ceil(kBlurReach * config.blur)));
    cv::GaussianBlur(sharp, blurred, cv::Size(2 * reach + 1, 2 * reach + 1), config.blur,
                     config.blur, cv::BORDER_REPLICATE);
  }
  develop();
  ++picture_number;
  return picture;
}

void SimulatedCamera::Workspace::collectLayers(const model::Shape& shape) {
  layers.clear();
  tag_poses = estimation::tagPoses(view.layout, shape);
  for (std::size_t i = 0; i < tag_poses.size(); ++i) {
    lie::SE3& X_CT = tag_poses[i];
    X_CT = view.X_CB * X_CT;
    const double depth = X_CT.translation.norm();
    if (-X_CT.rotation.col(2).dot(X_CT.translation) < kLeastCosine * depth) continue;
    layers.push_back({depth, static_cast<int>(i), -1});
  }

  const auto curve = model::sampleCurve(shape, kPiecesPerSection * view.sections + 1);
  nodes.assign(curve.size(), {});
  for (std::size_t i = 0; i < curve.size(); ++i) {
    const Eigen::Vector3d p_C = view.X_CB * curve[i].X.translation;
    const auto pixel = view.camera.project(p_C);
    nodes[i].depth = p_C.norm();
    if (!pixel || !(pixel->cwiseAbs().maxCoeff() < kFarOff)) continue;
    nodes[i].seen = true;
    nodes[i].pixel = {pixel->x(), pixel->y()};
    nodes[i].half_width = view.camera.fx * body.radius / p_C.z();
  }
  for (int i = 0; i + 1 < static_cast<int>(nodes.size()); ++i) {
    if (!nodes[i].seen || !nodes[i + 1].seen) continue;
    // By its far side, so that tags on its near side, and those beside them, come after it.
    layers.push_back({0.5 * (nodes[i].depth + nodes[i + 1].depth) + body.radius, -1, i});
  }
  std::sort(layers.begin(), layers.end(),
            [](const Layer& a, const Layer& b) { return a.depth > b.depth; });
}

void SimulatedCamera::Workspace::drawPiece(int piece) {
  const ArmNode& from = nodes[piece];
  const ArmNode& to = nodes[piece + 1];
  // Across the arm at each end, from the neighbours, so that pieces join without gaps.
  const auto across = [this](int i) {
    const int last = static_cast<int>(nodes.size()) - 1;
    const ArmNode& before = nodes[std::max(0, i - 1)].seen ? nodes[std::max(0, i - 1)] : nodes[i];
    const ArmNode& after =
        nodes[std::min(last, i + 1)].seen ? nodes[std::min(last, i + 1)] : nodes[i];
    const cv::Point2d along = after.pixel - before.pixel;
    const double length = std::hypot(along.x, along.y);
    const double scale = length > 0 ? nodes[i].half_width / length : 0.0;
    return cv::Point2d(-along.y * scale, along.x * scale);
  };
  const cv::Point2d across_from = across(piece), across_to = across(piece + 1);
  const double tone = piece % 2 == 0 ? 1.0 : kRingGray;
  for (const Band& band : kBands) {
    const cv::Point2d corners[] = {
        from.pixel + band.left * across_from, from.pixel + band.right * across_from,
        to.pixel + band.right * across_to, to.pixel + band.left * across_to};
    fillPolygon(sharp, corners, 4, tone * band.gray);
  }
}

cv::Rect SimulatedCamera::Workspace::boxOf(const lie::SE3& X_CT) const {
  const cv::Rect whole(0, 0, view.camera.width, view.camera.height);
  const double half = 0.5 * cells * cell;
  Eigen::Vector2d least = Eigen::Vector2d::Constant(kFarOff), most = -least;
  for (int i = 0; i < 4 * kOutlinePoints; ++i) {
    const double along = 2.0 * (i % kOutlinePoints) / kOutlinePoints - 1;
    const Eigen::Vector3d side[] = {{along, -1, 0}, {1, along, 0}, {-along, 1, 0}, {-1, -along, 0}};
    const auto pixel = view.camera.project(X_CT * (half * side[i / kOutlinePoints]));
    if (!pixel) return whole;  // it reaches out of what the camera can see
    least = least.cwiseMin(*pixel);
    most = most.cwiseMax(*pixel);
  }
  least = (least.array() - kOutlineMargin).max(-1.0);
  most = (most.array() + kOutlineMargin).min(kFarOff);
  if (!(least.x() < whole.width && least.y() < whole.height && most.x() >= 0 && most.y() >= 0)) {
    return {};
  }
  const cv::Point first(static_cast<int>(std::floor(least.x())),
                        static_cast<int>(std::floor(least.y())));
  const cv::Point last(static_cast<int>(std::ceil(most.x())),
                       static_cast<int>(std::ceil(most.y())));
  return cv::Rect(first, last + cv::Point(1, 1)) & whole;
}

void SimulatedCamera::Workspace::lookThrough(int y, const cv::Rect& box,
                                             const Eigen::Matrix3d& cells_of_direction,
                                             const TagPattern& pattern,
                                             std::vector<PlanePoint>& out) const {
  const auto* direction = directions.ptr<cv::Vec2f>(y) + box.x;
  TagPattern::Point hint{};
  for (int i = 0; i <= box.width; ++i) {
    const Eigen::Vector3d h =
        cells_of_direction * Eigen::Vector3d(direction[i][0], direction[i][1], 1.0);
    const double reach = kMostCells * h.z();  // negative behind the camera
    out[i].valid = std::abs(h.x()) < reach && std::abs(h.y()) < reach;
    if (!out[i].valid) continue;
    hint = pattern.at(h.x() / h.z(), h.y() / h.z(), hint);
    out[i].point = hint;
  }
}

// Every pixel's corners are seen through the camera on the tag's plane, and the quadrangle between
// them is measured exactly. Pixels tile the plane, so no edge moves and no area is lost; each line
// between two pixels is measured once.
void SimulatedCamera::Workspace::drawTag(int tag) {
  const lie::SE3& X_CT = tag_poses[tag];
  const TagPattern& pattern = patterns[tag];
  const cv::Rect box = boxOf(X_CT);
  if (box.empty()) return;

  Eigen::Matrix3d direction_of_cells;
  direction_of_cells.col(0) = cell * X_CT.rotation.col(0);
  direction_of_cells.col(1) = -cell * X_CT.rotation.col(1);  // rows run down
  direction_of_cells.col(2) =
      X_CT.translation -
      0.5 * cells * (direction_of_cells.col(0) + direction_of_cells.col(1)).eval();
  const Eigen::Matrix3d cells_of_direction = direction_of_cells.inverse();
  const double facing = -X_CT.rotation.col(2).dot(X_CT.translation) / X_CT.translation.norm();
  const double light = kAmbientLight + (1 - kAmbientLight) * facing;

  const auto lineBetween = [&pattern](const PlanePoint& a, const PlanePoint& b) {
    return a.valid && b.valid ? pattern.along(a.point, b.point) : Areas{};
  };
  const std::size_t corners = static_cast<std::size_t>(box.width) + 1;
  for (auto* points : {&above, &below}) points->resize(std::max(points->size(), corners));
  for (auto* lines : {&lines_above, &lines_below}) lines->resize(std::max(lines->size(), corners));

  for (int y = box.y; y <= box.y + box.height; ++y) {
    lookThrough(y, box, cells_of_direction, pattern, below);
    for (int i = 0; i < box.width; ++i) lines_below[i] = lineBetween(below[i], below[i + 1]);
    if (y > box.y) {
      uchar* row = sharp.ptr<uchar>(y - 1) + box.x;
      Areas left = lineBetween(above[0], below[0]);
      for (int i = 0; i < box.width; ++i) {
        const Areas right = lineBetween(above[i + 1], below[i + 1]);
        if (above[i].valid && above[i + 1].valid && below[i].valid && below[i + 1].valid) {
          Areas areas = lines_above[i];
          areas += right;
          areas -= lines_below[i];
          areas -= left;
          paintPixel(areas, light, row[i]);
        }
        left = right;
      }
    }
    std::swap(above, below);
    std::swap(lines_above, lines_below);
  }
}

void SimulatedCamera::Workspace::drawOccluders() {
  const double width = view.camera.width, height = view.camera.height;
  for (const Occluder& bar : occluders) {
    const double t = picture_number;
    const cv::Point2d center(width * (0.5 + kWander * std::sin(bar.x_rate * t + bar.x_phase)),
                             height * (0.5 + kWander * std::sin(bar.y_rate * t + bar.y_phase)));
    const double angle = bar.turn_rate * t + bar.turn_phase;
    const cv::Point2d right(std::cos(angle), std::sin(angle)), down(-right.y, right.x);
    const cv::Point2d a = bar.half_length * height * right, b = bar.half_width * height * down;
    const cv::Point2d corners[] = {center - a - b, center + a - b, center + a + b, center - a + b};
    fillPolygon(sharp, corners, 4, bar.gray);
  }
}

void SimulatedCamera::Workspace::develop() {
  const cv::Mat& light = config.blur > 0 ? blurred : sharp;
  const auto gain = static_cast<float>(config.exposure);
  for (int y = 0; y < light.rows; ++y) {
    const uchar* from = light.ptr<uchar>(y);
    const float* add = noise.data() + generator() % kNoiseTable;
    uchar* to = picture.ptr<uchar>(y);
    for (int x = 0; x < light.cols; ++x) {
      const float value = gain * static_cast<float>(from[x]) + add[x];
      to[x] = static_cast<uchar>(static_cast<int>(std::min(255.0F, std::max(0.0F, value))));
    }
  }
}

SimulatedCamera::SimulatedCamera(const ArmView& view, const vision::TagFamily& family,
                                 const ArmBody& body, const SimulatedCameraConfig& config)
    : work_(std::make_unique<Workspace>(view, family, body, config)) {}
SimulatedCamera::~SimulatedCamera() = default;
SimulatedCamera::SimulatedCamera(SimulatedCamera&&) noexcept = default;
SimulatedCamera& SimulatedCamera::operator=(SimulatedCamera&&) noexcept = default;

const cv::Mat& SimulatedCamera::render(const model::Shape& shape) { return work_->render(shape); }

}  // namespace helix_arm::simulation
