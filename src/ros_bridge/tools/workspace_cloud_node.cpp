#include <limits>

#include <sensor_msgs/PointCloud2.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/statics/workspace.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr int kMostPoints = 2000000;
constexpr double kPeriod = 1e-3;  // between pieces, so that callbacks are handled [s]

bool allPressures(const model::Arm& arm) {
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (!model::isPressure(arm.actuator(i).drive)) return false;
  }
  return true;
}

/// Private parameters of workspace_cloud.
struct WorkspaceCloudOptions {
  ParameterReader reader{ros::NodeHandle("~")};
  std::string scene = reader.file("scene", "config/scenes", ".yaml");  ///< as pressure_command's
  /// Inputs to sample.
  int count = reader.count("count", 100000, 1, kMostPoints);
  int seed = reader.count("seed", 1, 0, std::numeric_limits<int>::max());  ///< of the inputs
  std::string frame_prefix = reader.frame("frame_prefix", "");
  std::string scene_folder = reader.folder("scene_folder", defaultFolder());  ///< likewise

  WorkspaceCloudOptions() { reader.finish(); }
};

statics::Workspace workspaceOf(const io::Scene& scene, const WorkspaceCloudOptions& options,
                               bool sensitivity) {
  return statics::Workspace(scene.model, {static_cast<std::uint64_t>(options.seed), sensitivity});
}

/// Shows the reachable tip positions.
///
/// Publishes
/// - workspace (sensor_msgs/PointCloud2), latched, once it is complete, and empty when a reload
///   starts a new one: tips at inputs drawn evenly within their limits, in the arm's base frame,
///   float32: x, y, z [m] and, if all inputs are pressures, the tip displacement [m] for an error
///   of 1 kPa in every pressure (per_kpa_m), of 1 mm in every free length (per_mm_m) and of 1 % in
///   the stiffness (per_percent_K_m)
///
/// Service
/// - ~reload (Reload): another file of the same rig, whose cloud replaces the present one once it
///   is complete
///
/// Parameters: WorkspaceCloudOptions.
///
/// Ends with 0 if asked to, 1 if the ROS master is lost, 2 on a bad parameter or scene.
class WorkspaceCloudNode : public Node {
 public:
  WorkspaceCloudNode()
      : scene_(io::loadScene(options_.scene)),
        sensitivity_(allPressures(scene_.arm)),
        workspace_(workspaceOf(scene_, options_, sensitivity_)),
        reload_(ros::NodeHandle("~"), options_.scene, options_.scene_folder,
                [this](io::Scene next) { adopt(std::move(next)); }) {
    publisher_ = node_.advertise<sensor_msgs::PointCloud2>(names::kWorkspace, 1, true);
    timer_ = repeat(node_, "the sampling", kPeriod, &WorkspaceCloudNode::onTick, this);
  }

 private:
  void adopt(io::Scene next) {
    requireSameRig(scene_, next);
    workspace_ = workspaceOf(next, options_, sensitivity_);
    scene_ = std::move(next);
    values_.clear();
    sampled_ = unbalanced_ = 0;
    publish();  // the previous points are of another scene
    timer_.start();
  }

  void onTick(const ros::SteadyTimerEvent&) {
    const statics::WorkspacePoints points =
        workspace_.sample(static_cast<std::uint64_t>(sampled_),
                          std::min(workspace_.pieceSize(), options_.count - sampled_));
    for (int row = 0; row < points.count(); ++row) {
      for (int k = 0; k < 3; ++k) values_.push_back(static_cast<float>(points.tips(row, k)));
      for (int k = 0; k < points.sensitivity.cols() && sensitivity_; ++k) {
        values_.push_back(static_cast<float>(points.sensitivity(row, k)));
      }
    }
    sampled_ += points.count() + points.unbalanced;
    unbalanced_ += points.unbalanced;
    if (sampled_ < options_.count) return;
    timer_.stop();
    publish();
    tell();
  }

  void publish() {
    sensor_msgs::PointCloud2 cloud;
    cloud.header = toHeaderMsg(ros::Time::now(), options_.frame_prefix + names::kBaseFrame);
    std::vector<std::string> fields{"x", "y", "z"};
    if (sensitivity_) {
      fields.insert(fields.end(), std::begin(statics::kSensitivityNames),
                    std::end(statics::kSensitivityNames));
    }
    for (const std::string& name : fields) {
      sensor_msgs::PointField field;
      field.name = name;
      field.offset = cloud.point_step;
      field.datatype = sensor_msgs::PointField::FLOAT32;
      field.count = 1;
      cloud.fields.push_back(field);
      cloud.point_step += sizeof(float);
    }
    cloud.height = 1;
    cloud.width = static_cast<std::uint32_t>(values_.size() / fields.size());
    cloud.row_step = cloud.width * cloud.point_step;
    cloud.is_bigendian = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;
    cloud.is_dense = true;
    cloud.data.resize(values_.size() * sizeof(float));
    std::memcpy(cloud.data.data(), values_.data(), cloud.data.size());
    publisher_.publish(cloud);
  }

  void tell() const {
    const std::string tier = workspace_.model().choice().setting.name();
    if (unbalanced_ == options_.count) {
      logWarning(
          "%s: the cloud of the workspace is empty: by tier %s no shape balances the load at any "
          "of "
          "%d inputs; check the scene's load and K_eps, then reload",
          scene_.name.c_str(), tier.c_str(), options_.count);
      return;
    }
    logInfo("%s: %d tips by tier %s", scene_.name.c_str(), sampled_ - unbalanced_, tier.c_str());
    if (unbalanced_ == 0) return;
    logInfo("%s: %d of %d inputs are omitted, because no shape balances the load there",
            scene_.name.c_str(), unbalanced_, options_.count);
  }

  const WorkspaceCloudOptions options_{};
  io::Scene scene_;
  const bool sensitivity_;  // depends on the drives, which no reload changes
  statics::Workspace workspace_;
  int sampled_ = 0, unbalanced_ = 0;
  std::vector<float> values_;  ///< values of the points, one after the other

  ros::NodeHandle node_;
  ros::Publisher publisher_;
  ros::SteadyTimer timer_;
  ReloadServer reload_;
};

}  // namespace

std::unique_ptr<Node> makeWorkspaceCloud() { return std::make_unique<WorkspaceCloudNode>(); }

}  // namespace helix_arm::ros_bridge
