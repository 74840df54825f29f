"""Commands that refuse an option given twice, where the last one would win without a word."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

from kinid.errors import InputError


class Once(TyperCommand):
    """A command whose options have one value, unless they are lists."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As ever.

        Raises:
            InputError: an option with several values that takes one.
        """
        if not ctx.resilient_parsing:  # the shell completes what isn't finished yet
            given: list[Any] = self.make_parser(ctx).parse_args(list(args))[2]
            for option in dict.fromkeys(given):
                several = given.count(option)
                if several > 1 and option.nargs == 1 and not getattr(option, "multiple", True) and not option.is_flag:
                    name = max(option.opts, key=len)
                    raise InputError(f"{name} given {several} times", "one value", f"keep one: {option.help}")
        return super().parse_args(ctx, args)
