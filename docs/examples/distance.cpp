// How far two people are apart, by their roots: needs `panoptic run ... --publish roots`, and no message of ours.
#include <cmath>
#include <cstdio>
#include <geometry_msgs/msg/pose_array.hpp>
#include <rclcpp/rclcpp.hpp>

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  auto node = std::make_shared<rclcpp::Node>("distance");
  auto subscription = node->create_subscription<geometry_msgs::msg::PoseArray>(
    "skeletons/roots", rclcpp::SensorDataQoS(), [](const geometry_msgs::msg::PoseArray & people) {
      for (size_t a = 0; a < people.poses.size(); ++a) {
        for (size_t b = a + 1; b < people.poses.size(); ++b) {
          const auto & p = people.poses[a].position, & q = people.poses[b].position;
          std::printf("%zu and %zu: %.2f m\n", a, b, std::hypot(p.x - q.x, p.y - q.y, p.z - q.z));
        }
      }
    });
  rclcpp::spin(node);
  rclcpp::shutdown();
}
