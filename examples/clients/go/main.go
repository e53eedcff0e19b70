// A client of Wonderland in Go: its types and calls are generated (see docs/api/clients.md), this is what is left to write.
package main

import (
	"context"
	"encoding/json"
	"fmt"
	"log"
	"net/http"
	"os"
	"strings"

	"golang.org/x/oauth2/clientcredentials"

	"example.com/wonderland-client/wonderland"
)

func main() {
	ctx := context.Background()
	server := os.Getenv("WONDERLAND_URL")
	credentials := clientcredentials.Config{
		ClientID:     os.Getenv("CLIENT_ID"),
		ClientSecret: os.Getenv("CLIENT_SECRET"),
		TokenURL:     server + "/oauth/token",
	}
	api, err := wonderland.NewClientWithResponses(server, wonderland.WithHTTPClient(credentials.Client(ctx)))
	check(err)

	pads, err := api.ListPadsWithResponse(ctx, &wonderland.ListPadsParams{})
	check(err)
	for _, pad := range expected(pads.JSON200, pads.HTTPResponse, pads.Body).Items {
		fmt.Println("pad", pad.PadId, pad.Name, pad.Status)
	}

	sessions, err := api.ListSessionsWithResponse(ctx, &wonderland.ListSessionsParams{})
	check(err)
	for _, each := range expected(sessions.JSON200, sessions.HTTPResponse, sessions.Body).Items {
		session, err := api.ReadSessionWithResponse(ctx, each.SessionId, &wonderland.ReadSessionParams{})
		check(err)
		if verdict := expected(session.JSON200, session.HTTPResponse, session.Body).Verdict; verdict != nil {
			fmt.Println("session", each.UavId, each.State, verdict.Outcome, verdict.Block)
		}
	}

	wish := wonderland.NewProofRequest{UavId: "uav-1", PadId: "pad-1"}
	asked, err := api.AddProofRequestWithResponse(ctx, &wonderland.AddProofRequestParams{}, wish)
	check(err)
	request := expected(asked.JSON201, asked.HTTPResponse, asked.Body)
	fmt.Println("request", request.UavId, request.State)

	nobody, err := api.ReadPadWithResponse(ctx, "nowhere", &wonderland.ReadPadParams{})
	check(err)
	if problem := nobody.ApplicationproblemJSON404; problem != nil {
		fmt.Println("problem", problem.Type, problem.Status)
	}
}

// expected is the answer that was hoped for; whatever came instead is a problem, of one form for all operations.
func expected[T any](answer *T, response *http.Response, body []byte) *T {
	if answer != nil {
		return answer
	}
	var problem wonderland.ProblemDetails
	if !strings.HasPrefix(response.Header.Get("Content-Type"), "application/problem+json") {
		log.Fatalf("%s: %s", response.Status, body)
	}
	check(json.Unmarshal(body, &problem))
	log.Fatalf("%s: %s", problem.Type, problem.Detail)
	return nil
}

func check(err error) {
	if err != nil {
		log.Fatal(err)
	}
}
