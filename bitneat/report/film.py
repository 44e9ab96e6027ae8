# SPDX-License-Identifier: MIT
"""Pictures put together: as a GIF, as an MP4, as a strip; each with what is known of the moment written on it.

The bytes depend on the pictures and the versions of Pillow or ffmpeg alone.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bitneat.errors import BitneatError, MissingExtraError

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

    from bitneat.report.pictures import Moment

_PALETTE = 48
"""Colours of a GIF: flat drawings need few, and fewer pack better."""
_SAMPLES = 12
"""Frames that the palette is taken from."""
_HUNDREDTHS = 100
"""A GIF counts time in them."""
_LAST = 1000
"""Milliseconds that the last frame of a GIF stays."""
_INK, _PAPER = (20, 20, 20), (255, 255, 255)
_GAP = 4
"""Pixels between the pictures of a strip."""


def require_pillow() -> None:
    """Notice before the work that it could not be saved.

    Raises:
        MissingExtraError: if Pillow is not installed.
    """
    try:
        import PIL  # noqa: F401
    except ImportError:
        raise MissingExtraError("render: Pillow is not installed; pip install 'bitneat[render]'") from None


def require_ffmpeg() -> None:
    """As `require_pillow`, for MP4.

    Raises:
        MissingExtraError: if imageio-ffmpeg is not installed, or has no ffmpeg for this machine.
    """
    try:
        import imageio_ffmpeg
    except ImportError:
        raise MissingExtraError("render: imageio-ffmpeg is not installed; pip install 'bitneat[render]'") from None
    try:
        imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError:
        raise MissingExtraError("render: imageio-ffmpeg has no ffmpeg for this machine; install ffmpeg") from None


def frame(moment: Moment, width: int, generation: int | None) -> Picture:
    """The picture of a moment, ``width`` pixels wide, with a panel that has generation, reward and step."""
    picture = _scaled(moment, width)
    lines = [] if generation is None else [("generation", str(generation))]
    lines += [("reward", f"{moment.reward:.1f}"), ("step", str(moment.step))]
    _draw_panel(picture, lines)
    return picture


def gif(frames: Sequence[Picture], fps: float) -> bytes:
    """A GIF that loops for ever; each frame takes a whole number of hundredths of a second, at least two, the last one longer."""
    from PIL import Image

    palette = _palette(frames)
    small = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in frames]
    pause = max(round(_HUNDREDTHS / fps), 2) * (1000 // _HUNDREDTHS)
    pauses = [pause] * (len(small) - 1) + [max(pause, _LAST)]
    buffer = io.BytesIO()
    small[0].save(
        buffer, "GIF", save_all=True, append_images=small[1:], duration=pauses, loop=0, optimize=False, disposal=1
    )
    return buffer.getvalue()


def mp4(frames: Sequence[Picture], fps: float) -> bytes:
    """An MP4 (H.264, 4:2:0) that common players and browsers show; odd sizes lose a row or column of pixels.

    Raises:
        MissingExtraError: if imageio-ffmpeg is not installed.
        BitneatError: if ffmpeg fails.
    """
    require_ffmpeg()
    import imageio_ffmpeg

    width, height = (size - size % 2 for size in frames[0].size)
    exact = ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1", "-threads", "1"]
    with tempfile.TemporaryDirectory(prefix="bitneat-") as folder:
        path = Path(folder) / "film.mp4"
        writer = imageio_ffmpeg.write_frames(
            str(path), (width, height), fps=fps, macro_block_size=2, ffmpeg_log_level="error",
            output_params=[*exact, "-crf", "20", "-preset", "slow", "-movflags", "+faststart"],
        )  # fmt: skip
        try:
            writer.send(None)
            for picture in frames:
                writer.send(np.asarray(picture.crop((0, 0, width, height))).tobytes())
            writer.close()
        except OSError as error:
            raise BitneatError(f"render: ffmpeg failed: {' '.join(str(error).split())[:200]}") from None
        return path.read_bytes()


def strip(moments: Sequence[Moment], width: int, title: str) -> bytes:
    """Pictures side by side as a PNG, each ``width`` pixels wide, with step and reward below it; ``title`` is metadata."""
    from PIL import Image, ImageDraw
    from PIL.PngImagePlugin import PngInfo

    pictures = [_scaled(moment, width) for moment in moments]
    font = _font(width)
    caption = round(1.7 * font.size)
    height = pictures[0].height
    page = Image.new("RGB", ((width + _GAP) * len(pictures) - _GAP, height + caption), _PAPER)
    draw = ImageDraw.Draw(page)
    for place, (moment, picture) in enumerate(zip(moments, pictures, strict=True)):
        left = place * (width + _GAP)
        page.paste(picture, (left, 0))
        text = f"step {moment.step}, reward {moment.reward:.1f}"
        draw.text((left + width / 2, height + caption / 2), text, fill=_INK, font=font, anchor="mm")
    information = PngInfo()
    information.add_text("Title", title)
    information.add_text("Software", "bitneat")
    buffer = io.BytesIO()
    page.save(buffer, "PNG", pnginfo=information, optimize=True)
    return buffer.getvalue()


def _scaled(moment: Moment, width: int) -> Picture:
    from PIL import Image

    assert moment.image is not None
    picture = Image.fromarray(moment.image)
    height = max(round(picture.height * width / picture.width), 1)
    return picture if picture.size == (width, height) else picture.resize((width, height), Image.Resampling.LANCZOS)


def _font(width: int) -> Any:
    """Pillow's own, which is the same on every machine."""
    from PIL import ImageFont

    return ImageFont.load_default(max(round(width / 26), 10))


def _draw_panel(picture: Picture, lines: Sequence[tuple[str, str]]) -> None:
    from PIL import Image, ImageDraw

    font = _font(picture.width)
    line, pad = round(1.35 * font.size), round(0.6 * font.size)
    labels = max(font.getlength(label) for label, _ in lines)
    box = (round(labels + 5.2 * font.size) + 2 * pad, line * len(lines) + 2 * pad - round(0.3 * font.size))
    corner = (pad, pad)
    under = picture.crop((*corner, corner[0] + box[0], corner[1] + box[1]))
    picture.paste(Image.blend(under, Image.new("RGB", box, _PAPER), 0.8), corner)
    draw = ImageDraw.Draw(picture)
    for row, (label, value) in enumerate(lines):
        top = corner[1] + pad + row * line
        draw.text((corner[0] + pad, top), label, fill=_INK, font=font)
        draw.text((corner[0] + box[0] - pad, top), value, fill=_INK, font=font, anchor="ra")


def _palette(frames: Sequence[Picture]) -> Picture:
    """Colours for all frames, so that what stands still does not flicker."""
    from PIL import Image

    count = min(_SAMPLES, len(frames))
    chosen = [frames[i * (len(frames) - 1) // max(count - 1, 1)] for i in range(count)]
    rows: list[npt.NDArray[np.uint8]] = [np.asarray(picture) for picture in chosen]
    return Image.fromarray(np.concatenate(rows)).quantize(
        _PALETTE, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )
