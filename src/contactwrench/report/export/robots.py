"""The payload in the words of each maker's robot controller."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...assess.robot_arms import AGAINST_CONTROLLER
from ...calibration.calibration import Calibration
from ...geometry.arrays import Vector
from ...geometry.orientation import to_quat_xyzw
from .payload import Payload, fixed, payload_on_flange, principal_axes
from .target import Parameters, Setup, Target, commented, roll_pitch_yaw

NEEDS = "--sensor-offset, --sensor-mass, --sensor-com"
USES = ("sensor_offset", "sensor_mass", "sensor_com")
LOSES = "the bias, a base that leans (a setting of the robot)"
IN_MM, IN_CM = 1e3, 1e2


def _listed(vector: Vector, scale: float = 1.0, digits: int = 9, between: str = ", ") -> str:
    """A vector's numbers in a row, in m unless `scale` says otherwise."""
    return between.join(fixed(part, digits) for part in (scale * vector).tolist())


NOT_TAKEN = "moments of inertia are not in here: the command takes none"
FLANGE_AXES = "in flange axes"


def _mm(com: Vector) -> str:
    return _listed(com, IN_MM, 6)


def _ur(payload: Payload, calibration: Calibration) -> Parameters:
    """URScript manual: set_payload(m, cog), kg and m from the tool mount; set_target_payload(m, cog, inertia): matrix
    elements Ixx, Iyy, Izz, Ixy, Ixz, Iyz, kg m^2, with origin in the CoG and the axes aligned with the tool flange's;
    payload and force: universal-robots.com, SW10_6 prod-scriptmanual set_target_payload; set_gravity: article 7th-axis
    gravity settings, (0, 0, 9.82) on an upright base, the acceleration that holds the robot up.
    """
    mass, cog = fixed(payload.mass, 8), _listed(payload.com)
    R_controller_base = AGAINST_CONTROLLER.get(str(calibration.provenance.get("base_frame")), np.eye(3))
    upward = -calibration.g * R_controller_base @ calibration.gravity_direction
    x, y, z = (f"{part:.2f}" for part in (IN_MM * payload.com).tolist())
    body, other = (
        f"set_payload({mass}, [{cog}])\n",
        "where set_payload is deprecated, set_target_payload takes the same",
    )
    if payload.inertia is not None:
        moments = _listed(payload.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
        body = f"set_target_payload({mass}, [{cog}], [{moments}])\n"
        other = "a controller without set_target_payload takes set_payload with the first"
    return payload.parameters(
        body,
        "m",
        f"set_gravity([{_listed(upward, digits=6)}])",
        payload.inertia_written(f"{FLANGE_AXES}: xx, yy, zz, xy, xz, yz"),
        f"PolyScope, Installation, Payload: {payload.mass:.3f} kg, CX {x} mm, CY {y} mm, CZ {z} mm",
        f"{other} two arguments",
        "ur_msgs/srv/SetPayload: mass and center_of_gravity are these numbers",
        "setting a payload zeroes the force reading: do it with the tool free; get_tcp_force() has the payload "
        "subtracted already, so subtract nothing from it again",
    )


def _franka(payload: Payload, _: Calibration) -> Parameters:
    """frankaemika/libfranka include/franka/robot.h (setLoad), robot_state.h (m_total; I_load: with respect to the
    centre of mass, in the flange's axes as F_x_Cload is) and issue 48 (what stays on the
    flange is set in Desk); frankaemika/franka_ros2 franka_msgs/srv/SetLoad.srv.
    """
    mass, com = fixed(payload.mass, 8), _listed(payload.com)
    inertia = _listed(np.zeros(9) if payload.inertia is None else payload.inertia.T.ravel())
    of_a_point = (
        "whether a robot takes moments of inertia of 0 is not published: should it refuse, write 0.001 on the diagonal"
    )
    return payload.parameters(
        f"mass: {mass}\ncenter_of_mass: [{com}]\nload_inertia: [{inertia}]\n",
        "m",
        "no setting of libfranka",
        payload.inertia_written(FLANGE_AXES),
        f"libfranka: robot.setLoad({mass}, {{{com}}}, {{{inertia}}}); inertia about the centre of mass, column by "
        "column, kg m^2",
        "franka_msgs/srv/SetLoad; in ROS 1 center_of_mass is called F_x_center_load",
        "what stays on the flange may as well be Desk's end effector, with these numbers; the robot adds the two "
        "(m_total = m_ee + m_load): never both",
        *([of_a_point] if payload.inertia is None else []),
        "O_T_EE is the end effector's orientation: recorded with another F_T_EE than the flange's own axes (a Franka "
        "Hand: turned by -45 deg about z), turn center_of_mass and load_inertia by the rotation in F_T_EE",
    )


def _kuka(payload: Payload, _: Calibration) -> Parameters:
    """KRL's LOAD in $config.dat; frames and names: Beckhoff TF5120, KRC_WriteLoadData (M; X, Y, Z and A, B, C relative
    to the flange: of the principal inertia axes; JX, JY, JZ); A, B, C turn about z, y and x in turn, and the origin is
    the centre of mass: KUKA, MA KR IONTEC, load centre of gravity; LoadData of the LBR iiwa: examples of
    Sunrise.Connectivity (kg, mm).
    """
    mass, com = fixed(payload.mass, 8), (IN_MM * payload.com).tolist()
    x, y, z = (fixed(part, 6) for part in com)
    moments, R = (np.zeros(3), np.eye(3)) if payload.inertia is None else principal_axes(payload.inertia)
    a, b, c = (fixed(part, 6) for part in np.rad2deg(roll_pitch_yaw(R))[::-1].tolist())
    jx, jy, jz = (fixed(part, 9) for part in moments.tolist())
    return payload.parameters(
        f"LOAD_DATA[1]={{M {mass},CM {{X {x},Y {y},Z {z},A {a},B {b},C {c}}},J {{X {jx},Y {jy},Z {jz}}}}}\n",
        "mm",
        "$ROBROOT",
        payload.inertia_written("principal ones: A, B, C turn the flange's axes onto theirs"),
        "$config.dat of a KR C, with the number of your tool for 1, or by hand as the tool's load data (M; X, Y, Z mm; "
        "A, B, C deg; JX, JY, JZ kg m^2); $LOAD=LOAD_DATA[1] makes it active",
        f"LBR iiwa, Sunrise: LoadData load = new LoadData(); load.setMass({mass}); "
        f"load.setCenterOfMass({x}, {y}, {z});",
    )


def _abb(payload: Payload, _: Calibration) -> Parameters:
    """RAPID reference manual, loaddata and tooldata: kg, mm, quaternion q1..q4, kg m^2; the centre of gravity of a
    tool's load is in the wrist's coordinates, that of a payload in the tool's; aom: the principal axes, with their
    origin in the centre of gravity (ros-industrial/abb_robot_driver_interfaces, LoadData.msg); all inertia 0: a point.
    """
    moments, R = (np.zeros(3), np.eye(3)) if payload.inertia is None else principal_axes(payload.inertia)
    aom = np.roll(to_quat_xyzw(R), 1)
    return payload.parameters(
        f"PERS loaddata tool_with_sensor:=[{fixed(payload.mass, 8)},[{_listed(payload.com, IN_MM, 6, ',')}],"
        f"[{_listed(aom, between=',')}],{_listed(moments, between=',')}];\n",
        "mm",
        "Gravity Alpha with Gravity Beta (topic Motion, type Robot)",
        payload.inertia_written("principal ones: the quaternion turns the flange's axes onto theirs"),
        "the third part (tload) of your tooldata, which counts in the wrist's coordinates, tool0; GripLoad counts in "
        "the active tool's: there only with tool0",
    )


def _fanuc(payload: Payload, _: Calibration) -> Parameters:
    """The screen MOTION/PAYLOAD SET (kg, cm, kgf cm s^2; x up, y right and z out of the faceplate of an arm at zero,
    the axes of tool frame 0): Lincoln Electric, Setting robot payload. About which point the inertia counts, the centre
    of mass or the faceplate, differs from source to source, and products of inertia have no place.
    """
    centre = zip("XYZ", (IN_CM * payload.com).tolist(), strict=True)
    lines = [f"PAYLOAD           [kg]       : {fixed(payload.mass, 8)}"]
    lines += [f"PAYLOAD CENTER {axis}  [cm]       : {fixed(part, 7)}" for axis, part in centre]
    lines += [f"PAYLOAD INERTIA {axis} [kgfcms^2] : 0.0" for axis in "XYZ"]
    return payload.parameters(
        "".join(f"{line}\n" for line in lines),
        "cm",
        "the mount angle of the robot setup",
        "moments of inertia, found or not, are written as 0, a point mass: sources differ on the point about which "
        "this screen counts them, and products of inertia have no place in it",
        "MENU, SYSTEM, MOTION, DETAIL of a schedule; PAYLOAD[n] in a program makes schedule n active; the same as "
        "$PLST_GRP1[n].$PAYLOAD, $PAYLOAD_X, ...",
    )


def _xarm(payload: Payload, calibration: Calibration) -> Parameters:
    """xArm-Developer/xArm-Python-SDK xarm/wrapper/xarm_api.py (set_tcp_load: kg, mm) and xarm/x3/ft_sensor.py
    (set_ft_sensor_load_offset: mass, centre of mass in mm, offset; the sum for set_tcp_load takes it in m).
    """
    sign = -1.0 if calibration.provenance.get("sign") == "reaction" else 1.0
    own = f"{fixed(payload.tool_mass, 8)}, {_mm(payload.tool_com)}, {_listed(sign * calibration.bias)}"
    return payload.parameters(
        f"arm.set_tcp_load({fixed(payload.mass, 8)}, [{_mm(payload.com)}])\n",
        "mm",
        f"arm.set_gravity_direction([{_listed(calibration.gravity_direction)}])",
        NOT_TAKEN,
        f"UFACTORY's own sensor also takes arm.set_ft_sensor_load_offset([{own}]): tool's mass, centre of mass (mm) "
        "and offset (N, N m) in the sensor's axes. What the firmware makes of axes and signs is not published: use it "
        "only if arm.get_ft_sensor_data() then reads about 0 in several orientations of the free tool",
        "leave its association_setting_tcp_load False: SDK 1.17 adds mm to m there",
    )


def _fairino(payload: Payload, _: Calibration) -> Parameters:
    """FAIR-INNOVATION/fairino-python-sdk linux/fairino/Robot.py and FAIR-documentation
    source/SDKManual/PythonRobotForceControl.rst: SetLoadWeight kg, SetLoadCoord mm, SetForceSensorPayload kg,
    SetForceSensorPayloadCog mm.
    """
    mass = fixed(payload.mass, 8)
    return payload.parameters(
        f"robot.SetLoadWeight(0, {mass})\nrobot.SetLoadCoord({_mm(payload.com)})\n",
        "mm",
        "robot.SetRobotInstallAngle(yangle, zangle)",
        NOT_TAKEN,
        f"an SDK before load numbers takes robot.SetLoadWeight({mass})",
        f"a sensor that the controller reads: robot.SetForceSensorPayload({fixed(payload.tool_mass, 8)}), "
        f"robot.SetForceSensorPayloadCog({_mm(payload.tool_com)}): the tool alone, from the sensor's origin in its "
        "axes. The manual names no axes: use it only if the free tool then reads the same in several orientations",
    )


def _target(name: str, program: str, mark: str, parameters: Callable[[Payload, Calibration], Parameters]) -> Target:
    def of_payload(calibration: Calibration, setup: Setup) -> Parameters:
        return parameters(payload_on_flange(calibration, setup, name), calibration)

    return Target(name, program, NEEDS, LOSES, of_payload, commented(mark), USES)


TARGETS = (
    _target("ur", "Universal Robots: URScript and PolyScope", "#", _ur),
    _target("franka", "Franka: SetLoad", "#", _franka),
    _target("kuka", "KUKA: load data of KR C and LBR iiwa", ";", _kuka),
    _target("abb", "ABB: loaddata of RAPID", "!", _abb),
    _target("fanuc", "FANUC: payload schedule", "#", _fanuc),
    _target("xarm", "UFACTORY xArm: Python SDK", "#", _xarm),
    _target("fairino", "Fairino: Python SDK", "#", _fairino),
)
