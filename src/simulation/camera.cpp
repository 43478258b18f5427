#include "helix_arm/simulation/camera.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include <opencv2/imgproc.hpp>

#include "backdrop.hpp"
#include "helix_arm/basics/number_requirement.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"
#include "occluders.hpp"
#include "tag_painter.hpp"

namespace helix_arm::simulation {
namespace {

using estimation::ArmView;

constexpr double kLeastCosine = 0.02;  // of the angle of a face that is still drawn

// The arm is drawn as bands from rim to middle, with light from the left.
struct Band {
  double left, right;  // relative to half the width
  double gray;
};
constexpr std::array<Band, 5> kBands = {
    {{-1.0, 1.0, 62}, {-0.88, 0.82, 84}, {-0.72, 0.55, 104}, {-0.55, 0.2, 122}, {-0.4, -0.1, 136}}};
constexpr double kRingGray = 0.9;  // of every other piece of the arm, which gives it rings
constexpr int kPiecesPerSection = 32;
constexpr double kUsualRadius = 0.03;  // [m]

constexpr int kNoiseTable = 1 << 16;
constexpr double kBlurReach = 3.5;  // standard deviations

struct ArmNode {
  bool seen = false;
  cv::Point2d pixel;
  double per_metre = 0;  // focal length / depth [px/m]
  double depth = 0;      // [m]
};

// An object to draw; the farthest first.
struct Layer {
  double depth;  // [m]
  int tag;       // -1: a piece of the arm
  int piece;
};

}  // namespace

void SimulatedCameraConfig::validate() const {
  const char* const not_negative = "a finite value >= 0";
  basics::requireValue(std::isfinite(blur) && blur >= 0, kSimulatedCamera, "the blur [px]", blur,
                       not_negative);
  basics::requireValue(std::isfinite(noise) && noise >= 0, kSimulatedCamera,
                       "the noise [gray levels]", noise, not_negative);
  basics::requirePositive(kSimulatedCamera, "the exposure", exposure);
  basics::requireValue(std::isfinite(bleed) && bleed >= 0, kSimulatedCamera, "the bleed [m]", bleed,
                       not_negative);
  basics::requireValue(jpeg_quality >= 1 && jpeg_quality <= 100, kSimulatedCamera,
                       "the JPEG quality", jpeg_quality, "1 to 100");
  basics::requireValue(clutter >= 0, kSimulatedCamera, "the number of objects in the background",
                       clutter, "a value >= 0");
  basics::requireValue(occluders >= 0, kSimulatedCamera, "the number of occluders", occluders,
                       "a value >= 0");
}

struct SimulatedCamera::Workspace {
  Workspace(const ArmView& view_in, const std::vector<CardPrint>& prints, const ArmBody& body_in,
            const SimulatedCameraConfig& config_in);

  const cv::Mat& render(const model::Shape& shape);

  void collectLayers(const model::Shape& shape);
  void drawPiece(int piece);
  double radiusOf(int piece) const {
    if (body.radius.empty()) return kUsualRadius;
    return body.radius[std::min(piece / kPiecesPerSection, view.sections - 1)];
  }
  void develop();

  ArmView view;
  ArmBody body;
  SimulatedCameraConfig config;
  TagPainter tags;
  cv::Mat backdrop, sharp, blurred, picture;
  std::vector<float> noise;  // added by develop() before truncation
  std::mt19937 generator;
  Occluders occluders;
  int picture_number = 0;

  // State of the picture that is being rendered.
  std::vector<lie::SE3> tag_poses;  // X_CT
  std::vector<ArmNode> nodes;
  std::vector<Layer> layers;
};

namespace {

// Returns the view after checking all parts.
const ArmView& checked(const ArmView& view, const ArmBody& body,
                       const SimulatedCameraConfig& config) {
  view.validate();
  config.validate();
  basics::requireValue(
      body.radius.empty() || body.radius.size() == static_cast<std::size_t>(view.sections),
      kSimulatedCamera, "the number of radii", static_cast<double>(body.radius.size()),
      "one per section");
  for (const double radius : body.radius) {
    basics::requirePositive(kSimulatedCamera, "the arm's radius [m]", radius);
  }
  return view;
}

std::vector<CardPrint> printsOf(const estimation::TagLayout& layout,
                                const vision::TagFamily& family) {
  std::vector<CardPrint> prints;
  for (const estimation::TagPlacement& tag : layout.tags) {
    basics::requireValue(tag.id < family.count(), kSimulatedCamera, "the id of a tag", tag.id,
                         "one that the family of the tags has");
    prints.push_back(tagPrint(family, tag.id, layout.size));
  }
  return prints;
}

// Includes 0.5, so that truncation becomes rounding.
std::vector<float> noiseTable(double deviation, std::uint32_t seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  std::vector<float> table(kNoiseTable);
  for (float& value : table) value = static_cast<float>(0.5 + deviation * normal(generator));
  return table;
}

}  // namespace

SimulatedCamera::Workspace::Workspace(const ArmView& view_in, const std::vector<CardPrint>& prints,
                                      const ArmBody& body_in,
                                      const SimulatedCameraConfig& config_in)
    : view(checked(view_in, body_in, config_in)),
      body(body_in),
      config(config_in),
      tags(view.camera, prints, config.bleed),
      generator(config.seed),
      occluders(config.occluders, generator) {
  const estimation::Camera& camera = view.camera;
  backdrop = paintBackdrop(camera.width, camera.height, config.clutter, config.seed);
  noise = noiseTable(config.noise, config.seed);
  noise.resize(kNoiseTable + camera.width);  // a row may begin anywhere in the table
  for (int x = 0; x < camera.width; ++x) noise[kNoiseTable + x] = noise[x % kNoiseTable];
  picture.create(camera.height, camera.width, CV_8UC1);
}

const cv::Mat& SimulatedCamera::Workspace::render(const model::Shape& shape) {
  basics::requireValue(shape.sectionCount() == view.sections, kSimulatedCamera,
                       "the number of sections", shape.sectionCount(),
                       "one per section of the arm in view");
  basics::requireValue(shape.pieces().allFinite(), kSimulatedCamera, "a twist", "not finite",
                       "finite twists");
  backdrop.copyTo(sharp);
  collectLayers(shape);
  for (const Layer& layer : layers) {
    if (layer.tag < 0) {
      drawPiece(layer.piece);
    } else {
      tags.draw(layer.tag, tag_poses[layer.tag], sharp);
    }
  }
  occluders.draw(picture_number, sharp);
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

  const auto curve = model::sampleToTip(shape, kPiecesPerSection * view.sections + 1);
  nodes.assign(curve.size(), {});
  for (std::size_t i = 0; i < curve.size(); ++i) {
    const Eigen::Vector3d p_C = view.X_CB * curve[i].X.translation;
    const auto pixel = view.camera.project(p_C);
    nodes[i].depth = p_C.norm();
    if (!pixel || !(pixel->cwiseAbs().maxCoeff() < kFarOff)) continue;
    nodes[i].seen = true;
    nodes[i].pixel = {pixel->x(), pixel->y()};
    nodes[i].per_metre = view.camera.fx / p_C.z();
  }
  for (int i = 0; i + 1 < static_cast<int>(nodes.size()); ++i) {
    if (!nodes[i].seen || !nodes[i + 1].seen) continue;
    // Its depth is that of its far side, so that tags on its near side and beside it are drawn
    // later.
    layers.push_back({0.5 * (nodes[i].depth + nodes[i + 1].depth) + radiusOf(i), -1, i});
  }
  std::sort(layers.begin(), layers.end(),
            [](const Layer& a, const Layer& b) { return a.depth > b.depth; });
}

void SimulatedCamera::Workspace::drawPiece(int piece) {
  const ArmNode& from = nodes[piece];
  const ArmNode& to = nodes[piece + 1];
  // Direction across the arm at each end, from the neighbours, so that pieces join without gaps.
  const double radius = radiusOf(piece);
  const auto across = [this, radius](int i) {
    const int last = static_cast<int>(nodes.size()) - 1;
    const ArmNode& before = nodes[std::max(0, i - 1)].seen ? nodes[std::max(0, i - 1)] : nodes[i];
    const ArmNode& after =
        nodes[std::min(last, i + 1)].seen ? nodes[std::min(last, i + 1)] : nodes[i];
    const cv::Point2d along = after.pixel - before.pixel;
    const double length = std::hypot(along.x, along.y);
    const double scale = length > 0 ? radius * nodes[i].per_metre / length : 0.0;
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
    : SimulatedCamera(view, printsOf(checked(view, body, config).layout, family), body, config) {}
SimulatedCamera::SimulatedCamera(const ArmView& view, const std::vector<CardPrint>& prints,
                                 const ArmBody& body, const SimulatedCameraConfig& config)
    : work_(std::make_unique<Workspace>(view, prints, body, config)) {}
SimulatedCamera::~SimulatedCamera() = default;
SimulatedCamera::SimulatedCamera(SimulatedCamera&&) noexcept = default;
SimulatedCamera& SimulatedCamera::operator=(SimulatedCamera&&) noexcept = default;

const cv::Mat& SimulatedCamera::render(const model::Shape& shape) { return work_->render(shape); }

}  // namespace helix_arm::simulation
