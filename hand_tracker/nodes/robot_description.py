"""Keep the URDF of robot_state_publisher that of the tracked hand."""

from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

PUBLISHER = 'robot_state_publisher'  # node of the launch file, in the namespace of the tracker


class RobotDescription:
    """The `robot_description` of the robot_state_publisher beside a node.

    Parameters
    ----------
    node : Node
    urdf : str
        That robot_state_publisher was started with.
    namespace : str, optional
        Of robot_state_publisher in the node's: empty, or 'right/'.

    Attributes
    ----------
    wanted : str
        URDF that it is to have.
    """

    def __init__(self, node: Node, urdf: str, namespace: str = '') -> None:
        self.wanted = self._sent = urdf
        self._node = node
        self._client = node.create_client(
            SetParameters, f'{namespace}{PUBLISHER}/set_parameters')

    def update(self) -> None:
        """Send the wanted URDF if it is another, as soon as robot_state_publisher runs."""
        if self.wanted == self._sent or not self._client.service_is_ready():
            return
        self._sent = self.wanted
        description = Parameter('robot_description', Parameter.Type.STRING, self.wanted)
        done = self._client.call_async(
            SetParameters.Request(parameters=[description.to_parameter_msg()]))
        done.add_done_callback(self._check)

    def _check(self, done: Future) -> None:
        refused = [result.reason for result in done.result().results if not result.successful]
        if refused:
            self._node.get_logger().warning(
                f'{PUBLISHER} refuses the URDF of the hand: {refused[0]}')
