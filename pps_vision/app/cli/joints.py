"""`pps-vision joints`: offsets of an iCub's encoders, from recordings in which its skin is touched."""

from dataclasses import dataclass

from pps_vision.app.cli.options import RecordingOptions


@dataclass(frozen=True)
class Joints(RecordingOptions):
    """Learn the offsets of an iCub's encoders (neck, eyes, arms): a touch must be seen where it is felt.

    The table (.csv: joint,offset_deg) is for --joints of track and learn.  A dozen touches in several postures suffice.
    """

    def run(self) -> None:
        import numpy as np

        from learning.pps.joint_offsets import TouchTrial, joint_offsets
        from learning.pps.memory import PPSMemory
        from pps_vision.app.learn import learn_from
        from pps_vision.errors import InputError
        from pps_vision.recordings.atomic_write import whole_file
        from pps_vision.recordings.tables import write_joint_offsets
        from pps_vision.robot.icub import icub_setup

        setup = icub_setup()
        empty = PPSMemory.empty(setup.skin)
        touches: list[TouchTrial] = []
        with whole_file(self.out, self.inputs) as partial:
            self.use_each(
                "joints", lambda rec: touches.extend(learn_from(rec, empty, self.mode, self.seed, setup).touches)
            )
            learned = joint_offsets(setup.robot, setup.rig, setup.skin, touches)
            n = len(learned.before_m)
            if not n:
                names = ", ".join(map(str, self.recordings))
                raise InputError("joints", f"no touch by a tracked object in {names}; expected one or more")
            write_joint_offsets(partial, setup.robot.joint_names, learned.offsets_rad)
        without_mm = 1000 * float(np.median(learned.before_m))
        with_mm = 1000 * float(np.median(learned.after_m))
        print(
            f"{n} touches, seen {without_mm:.0f} mm from where they were felt, {with_mm:.0f} with offsets → {self.out}"
        )
