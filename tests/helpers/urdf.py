"""Robots described joint by joint."""

from pathlib import Path


def joint(
    name: str,
    parent: str,
    child: str,
    xyz: str = "0 0 0",
    axis: str = "0 0 1",
    kind: str = "revolute",
    rpy: str = "0 0 0",
) -> str:
    """A joint that turns or slides from -2 to 2, or is fixed, and its child."""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        f'<limit lower="-2" upper="2" effort="1" velocity="1"/></joint><link name="{child}"/>'
    )


def write_urdf(file: Path, *parts: str) -> Path:
    """Write a robot of these parts about a link `base`; returns the file."""
    file.write_text(f'<robot name="made_up"><link name="base"/>{"".join(parts)}</robot>')
    return file
