#!/usr/bin/env bash
# What action.yml runs: audits the maps named in MAPS, one a line, each into a folder of its own.
#   AMBINAV     the command                 SCANNER  a preset or a file
#   MAPS        files, patterns or folders  OUTPUT   folder of the reports
#   CONDITIONS  one a line, or nothing      OPTIONS  further options, as in a shell, on any lines
# Ends with 3 where a condition holds, else with the first other status that is not 0.
# All maps are audited, whatever becomes of one.
set -uo pipefail
: "${AMBINAV:?}" "${SCANNER:?}" "${OUTPUT:?}" "${MAPS?}" "${CONDITIONS?}" "${OPTIONS?}"
shopt -s globstar nullglob

is_map() { # of YAML files only those of map_server, not the parameters of a node that lie beside it
    [[ "$1" != *.yaml && "$1" != *.yml ]] || { grep -qE '^image *:' "$1" && grep -qE '^resolution *:' "$1"; }
}

# Text in what GitHub reads of a line that begins with ::
escaped() {
    local text="${1//%/%25}"
    text="${text//:/%3A}"
    printf '%s' "${text//,/%2C}"
}

maps=()
named=""
while IFS= read -r line; do
    line="${line#"${line%%[![:space:]]*}"}"
    line="${line%"${line##*[![:space:]]}"}"
    [[ -n "$line" ]] || continue
    if [[ -d "$line" ]]; then
        files=("${line%/}"/**/*.yaml "${line%/}"/**/*.yml)
        # They may as well be zones or graphs of routes.
        for file in "${line%/}"/**/*.{geojson,wkt,dxf,ifc}; do
            echo "ambinav: note: $file: plans in a folder are not audited; name the file." >&2
        done
    elif [[ -e "$line" ]]; then
        files=("$line")
    else
        IFS= # so that blanks in a pattern do not part it
        # shellcheck disable=SC2206 # a pattern is to be expanded
        files=($line)
        unset IFS
    fi
    found=()
    for file in "${files[@]}"; do
        # What is no pattern stays as it is.
        [[ -e "$file" ]] && is_map "$file" && found+=("${file#./}")
    done
    if ((${#found[@]} == 0)); then
        echo "ambinav: error: $line: there is no such map; name a map file, a pattern or a folder of maps." >&2
        exit 2
    fi
    for file in "${found[@]}"; do
        [[ $'\n'"$named" == *$'\n'"$file"$'\n'* ]] || maps+=("$file")
        named+="$file"$'\n'
    done
done <<<"$MAPS"
if ((${#maps[@]} == 0)); then
    echo "ambinav: error: map: no map is named; name a map file, a pattern or a folder of maps." >&2
    exit 2
fi

conditions=()
while IFS= read -r line; do
    [[ -n "${line//[[:space:]]/}" ]] && conditions+=(--fail-if "$line")
done <<<"$CONDITIONS"
options=()
if [[ -n "${OPTIONS//[[:space:]]/}" ]]; then
    if ! parts="$(tr -d '\r' <<<"$OPTIONS" | xargs printf '%s\n')"; then
        echo "ambinav: error: options: a quotation mark has no other; give both." >&2
        exit 2
    fi
    while IFS= read -r part; do options+=("$part"); done <<<"$parts"
fi

held=0
status=0
for map in "${maps[@]}"; do
    # A slash becomes __; what could be taken for one is written as in addresses, so that no two maps
    # share a folder.
    name="${map#./}"
    name="${name//%/%25}"
    # Letters that artifacts may not have in names.
    name="${name//:/%3A}"
    name="${name//\"/%22}"
    name="${name//</%3C}"
    name="${name//>/%3E}"
    name="${name//|/%7C}"
    name="${name//\*/%2A}"
    name="${name//\?/%3F}"
    name="${name//__/%5F%5F}"
    name="${name//_\//%5F/}"
    name="${name//\/_//%5F}"
    name="${name//\//__}"
    gate=()
    if ((${#conditions[@]})); then
        gate=("${conditions[@]}" --junit "$OUTPUT/junit/$name.xml" --sarif "$OUTPUT/sarif/$name.sarif")
    fi
    echo "::group::$map"
    "$AMBINAV" audit "$map" --scanner "$SCANNER" -o "$OUTPUT/$name" "${options[@]}" "${gate[@]}"
    code=$?
    echo "::endgroup::"
    if ((code == 3)); then
        held=3
        echo "::error file=$(escaped "$map")::a condition of the audit holds; see the report in $OUTPUT/$name"
    elif ((code != 0)); then
        ((status == 0)) && status=$code
        echo "::error file=$(escaped "$map")::the audit ended with status $code"
    fi
    if [[ -n "${GITHUB_STEP_SUMMARY:-}" && -f "$OUTPUT/$name/report.json" ]]; then
        python3 - "$OUTPUT/$name/report.json" "$map" "$code" >>"$GITHUB_STEP_SUMMARY" <<'PYTHON'
import json
import sys

path, name, code = sys.argv[1:]
word = {"0": "passed", "3": "failed"}.get(code, f"ended with status {code}")
with open(path, encoding="utf-8") as file:
    print(f"### {name}: {word}\n\n{json.load(file)['summary']}\n")
PYTHON
    fi
done
exit $((held ? held : status))
