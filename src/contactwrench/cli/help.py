"""How `--help` is laid out: verbs with all that they say of themselves, and the options of reading apart from a verb's
own, of which a user needs few.
"""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand, TyperGroup

ARGUMENTS, OWN = "Arguments", "Options"


class Verb(TyperCommand):
    """A verb whose options are in sections, each in that of its panel."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options."""
        sections: dict[str, list[tuple[str, str]]] = {ARGUMENTS: [], OWN: []}
        for parameter in self.get_params(ctx):
            if record := parameter.get_help_record(ctx):
                own = ARGUMENTS if parameter.param_type_name == "argument" else OWN
                sections.setdefault(getattr(parameter, "rich_help_panel", None) or own, []).append(record)
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


class Verbs(TyperGroup):
    """The program, whose verbs are not cut off in mid-sentence."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write each verb with the first paragraph of its help."""
        verbs = [(name, self.commands[name].help or "") for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl([(name, " ".join(help.split("\n\n")[0].split())) for name, help in verbs])
