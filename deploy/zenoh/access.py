"""Write the configuration of a zenoh router: a template of this folder with the rules of who may say what.

    python3 access.py members.toml router.tls.json5 > /etc/zenoh/router.json5

zenoh has no rule with the sender's own name in it, so each member gets rules of its own. Nobody may do what no rule
allows: delete, put under another's name or on a wildcard, read what vehicles send. As long as its place is not filled,
zenoh refuses to start from a template.
"""

import json
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

NAME = re.compile("[A-Za-z0-9_.~-]{1,64}")
PLACE = re.compile('"@(cert_common_names|usernames)@"')

PUBLISHED = [
    "{site}/alert/*/*",
    "{site}/pair/*/state",
    "{site}/quality/*",
    "{site}/rejected/*",
    "{site}/handling/*",
    "{site}/health/*",
]
ASKED = ["{site}/alerts", "{site}/pairs", "{site}/handling"]
ALIVE = ["{prefix}/@headway/*"]
EPOCHS = ["{site}/@headway/*/*"]

# Flow, as the router sees it; messages; keys.
ROLES = {
    "senders": [
        ("ingress", ["put"], ["{site}/bsm/{name}"]),
        ("egress", ["declare_subscriber"], ["{site}/bsm/**"]),
    ],
    "services": [
        ("ingress", ["declare_subscriber"], ["{site}/bsm/**", "{site}/health/*"]),
        ("egress", ["put"], ["{site}/bsm/*", "{site}/health/*"]),
        ("ingress", ["put"], [*PUBLISHED[:-1], "{site}/health/{name}"]),
        ("egress", ["declare_subscriber"], PUBLISHED),
        ("ingress", ["declare_queryable", "reply"], ASKED),
        ("egress", ["query"], ASKED),
        ("ingress", ["put"], ["{prefix}/*/handover/{own}/*"]),
        ("egress", ["declare_subscriber"], ["{prefix}/*/handover/{own}/*"]),
        ("ingress", ["declare_subscriber"], ["{site}/handover/*/*"]),
        ("egress", ["put"], ["{site}/handover/*/*"]),
        ("ingress", ["liveliness_token"], ["{prefix}/@headway/{name}", "{site}/@headway/*/{name}"]),
        ("ingress", ["declare_liveliness_subscriber", "liveliness_query"], EPOCHS),
        ("egress", ["liveliness_token"], EPOCHS),
    ],
    "dashboards": [
        ("ingress", ["declare_subscriber"], [*PUBLISHED, "{site}/alert/**"]),
        ("egress", ["put"], PUBLISHED),
        ("ingress", ["query"], ASKED),
        ("egress", ["declare_queryable", "reply"], ASKED),
        ("ingress", ["declare_liveliness_subscriber", "liveliness_query"], ALIVE),
        ("egress", ["liveliness_token"], ALIVE),
    ],
}


def access_control(members: dict[str, Any], identified_by: str) -> dict[str, Any]:
    """Return zenoh's `access_control`; `identified_by` is zenoh's word for what a member is known by."""
    rules, policies, names = [], [], set()
    for site, role, name in _roster(members):
        chunks = {"prefix": members["prefix"], "site": f"{members['prefix']}/{site}", "own": site, "name": name}
        its_rules = [
            {
                "id": f"{site} {role} {name} {number}",
                "permission": "allow",
                "flows": [flow],
                "messages": messages,
                "key_exprs": [key.format_map(chunks) for key in keys],
            }
            for number, (flow, messages, keys) in enumerate(ROLES[role])
        ]
        rules += its_rules
        policies.append({"rules": [rule["id"] for rule in its_rules], "subjects": [name]})
        names.add(name)
    subjects = [{"id": name, identified_by: [name]} for name in sorted(names)]
    return {"enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}


def _roster(members: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    for site, roles in members["sites"].items():
        for role, names in roles.items():
            if role not in ROLES:
                raise ValueError(f"{role}: a role is one of {', '.join(ROLES)}")
            for name in names:
                if not (NAME.fullmatch(site) and NAME.fullmatch(name)):
                    raise ValueError(f"{site}, {name}: a name is 1 to 64 of letters, digits and _ . ~ -")
                yield site, role, name


def fill(template: str, members: dict[str, Any]) -> str:
    """Return the template with the rules in their place."""
    filled, places = PLACE.subn(lambda place: json.dumps(access_control(members, place[1]), indent=2), template)
    if places != 1:
        raise ValueError("the template needs one place for the rules")
    return filled


def main(members_file: str, template_file: str) -> None:
    """Print the filled template."""
    members = tomllib.loads(Path(members_file).read_text(encoding="utf-8"))
    sys.stdout.write(fill(Path(template_file).read_text(encoding="utf-8"), members))


if __name__ == "__main__":
    main(*sys.argv[1:])
