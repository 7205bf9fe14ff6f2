// The floor of ROS 2: takes a MarkerArray as bytes, gives a ready JointState with its stamp.
// Usage: echo FILE [--ros-args ...], where FILE holds the bytes of the JointState.

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include <rcl/error_handling.h>
#include <rcl/rcl.h>
#include <sensor_msgs/msg/joint_state.h>
#include <visualization_msgs/msg/marker_array.h>

#define CHECK(call) if ((call) != RCL_RET_OK) { fprintf(stderr, "failed: %s\n", #call); return 1; }

enum {STAMP_IN = 8, STAMP_OUT = 4, STAMP = 8, LONGEST = 1 << 16};

int main(int argc, char ** argv)
{
  rcl_allocator_t allocator = rcl_get_default_allocator();
  rcl_serialized_message_t in = rmw_get_zero_initialized_serialized_message();
  rcl_serialized_message_t out = rmw_get_zero_initialized_serialized_message();
  CHECK(rmw_serialized_message_init(&in, LONGEST, &allocator));
  CHECK(rmw_serialized_message_init(&out, LONGEST, &allocator));
  FILE * file = argc > 1 ? fopen(argv[1], "rb") : NULL;
  if (!file) {
    fprintf(stderr, "no file\n");
    return 1;
  }
  out.buffer_length = fread(out.buffer, 1, LONGEST, file);
  fclose(file);

  rcl_init_options_t init_options = rcl_get_zero_initialized_init_options();
  CHECK(rcl_init_options_init(&init_options, allocator));
  rcl_context_t context = rcl_get_zero_initialized_context();
  CHECK(rcl_init(argc, (char const * const *)argv, &init_options, &context));
  rcl_node_t node = rcl_get_zero_initialized_node();
  rcl_node_options_t node_options = rcl_node_get_default_options();
  CHECK(rcl_node_init(&node, "echo", "", &context, &node_options));

  rcl_publisher_t publisher = rcl_get_zero_initialized_publisher();
  rcl_publisher_options_t publisher_options = rcl_publisher_get_default_options();
  CHECK(rcl_publisher_init(
      &publisher, &node, ROSIDL_GET_MSG_TYPE_SUPPORT(sensor_msgs, msg, JointState),
      "joint_states", &publisher_options));
  rcl_subscription_t subscription = rcl_get_zero_initialized_subscription();
  rcl_subscription_options_t subscription_options = rcl_subscription_get_default_options();
  subscription_options.qos.reliability = RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT;
  subscription_options.qos.depth = 5;
  CHECK(rcl_subscription_init(
      &subscription, &node, ROSIDL_GET_MSG_TYPE_SUPPORT(visualization_msgs, msg, MarkerArray),
      "markers", &subscription_options));

  rcl_wait_set_t wait_set = rcl_get_zero_initialized_wait_set();
  CHECK(rcl_wait_set_init(&wait_set, 1, 0, 0, 0, 0, 0, &context, allocator));
  pid_t parent = getppid();
  while (getppid() == parent) {
    CHECK(rcl_wait_set_clear(&wait_set));
    CHECK(rcl_wait_set_add_subscription(&wait_set, &subscription, NULL));
    if (rcl_wait(&wait_set, RCL_MS_TO_NS(100)) != RCL_RET_OK) {
      continue;
    }
    while (rcl_take_serialized_message(&subscription, &in, NULL, NULL) == RCL_RET_OK) {
      memcpy(out.buffer + STAMP_OUT, in.buffer + STAMP_IN, STAMP);
      CHECK(rcl_publish_serialized_message(&publisher, &out, NULL));
    }
    rcl_reset_error();
  }
  return 0;
}
